"""The command line: options and work of every verb."""
