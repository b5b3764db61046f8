"""Imports runs of other programs and exports our runs."""
