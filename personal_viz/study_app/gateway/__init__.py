"""Our web server in front of viser: who comes in, what passes, and the workers behind it."""
