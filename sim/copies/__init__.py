"""What browsers and recordings get of a home: one storey without its ceiling, few triangles, small textures."""
