"""Explore, map, ground: where on a map is the object that the query names."""
