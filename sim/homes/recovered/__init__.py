"""Schematic homes from episode files alone: floor at recorded standing places, objects at their recorded places."""
