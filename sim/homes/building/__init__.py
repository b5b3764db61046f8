"""Plan to triangles: walls, floors, stairs, windows, textures and soft light."""
