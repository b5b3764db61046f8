"""Schematic homes from episode files alone: floor where somebody stood, objects where they were recorded."""
