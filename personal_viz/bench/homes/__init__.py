"""Measures how well recovered and invented homes serve their episodes."""
