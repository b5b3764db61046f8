"""Invents homes from a seed: layouts, rooms and furniture."""
