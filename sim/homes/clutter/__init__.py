"""Clutter: things without a caption, of which real homes are full."""
