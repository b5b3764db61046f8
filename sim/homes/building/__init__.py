"""Turns plans into triangles: walls, floors, stairs, windows, textures and soft light."""
