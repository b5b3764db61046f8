"""People do the same tasks as agents."""
