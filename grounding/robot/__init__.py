"""A real robot's posed RGB-D frames, read from a folder."""
