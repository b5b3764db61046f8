"""Pieces of furniture as shapes: one family builds many categories."""
