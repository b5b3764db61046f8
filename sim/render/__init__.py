"""Renders views of a mesh as colour, planar depth and object ids, and casts single rays."""
