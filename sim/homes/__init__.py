"""A home: its plan, the triangles made of it, and where both come from (a scan, a seed, or episode files alone)."""
