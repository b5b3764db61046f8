"""Behaviour that a rebuilding must leave equal: what commit 0d21b8b answered, stored as literals, asked again."""
