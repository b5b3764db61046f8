"""Runs of other programs in, our runs out."""
