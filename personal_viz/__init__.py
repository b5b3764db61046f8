"""The viser apps, their gateway and the command line."""
