"""Posed RGB-D frames of a real robot or phone: one reader per layout, and their frames in the map's frame."""
