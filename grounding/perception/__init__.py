"""Segmenters that cut views into things, and oracle perception with adjustable errors."""
