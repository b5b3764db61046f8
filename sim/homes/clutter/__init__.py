"""The things that no caption names, as real homes are full of them."""
