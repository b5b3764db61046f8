"""What an exploration has seen, and where it is kept."""
