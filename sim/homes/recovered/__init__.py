"""Recovers schematic homes from episode files alone: floor at recorded standing places, objects at recorded places."""
