"""The pictures of the README and of the instructions, made from the running program: `make screenshots`."""
