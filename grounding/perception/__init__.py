"""Scores, boxes and masks of pictures: real models, and oracle perception with adjustable errors."""
