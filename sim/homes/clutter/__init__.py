"""Clutter: the many things without a caption that fill real homes."""
