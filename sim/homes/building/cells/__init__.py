"""Builds homes whose plans give cells: rooms, straight walls, openings and flights."""
