"""Homes from a seed: layouts, rooms, and what stands in them."""
