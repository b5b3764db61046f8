"""A page with a row per episode: gathers runs, compares people with agents, draws sheets, writes the index."""

PICTURE_WIDTH = 320
"""Width of what robots saw, in recordings (pixels); small, because a study's recordings hold millions of pictures."""
