"""Shows recordings to people: Rerun's own program, its windows, and its web viewer served on loopback."""
