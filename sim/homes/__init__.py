"""Homes: their plans, the triangles made of them, and their sources (a scan, a seed, or episode files alone)."""
