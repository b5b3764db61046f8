"""Homes from a seed: layouts, rooms and furniture."""
