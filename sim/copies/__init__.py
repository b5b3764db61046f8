"""Copies of a home for browsers and recordings: one storey without its ceiling, few triangles, small textures."""
