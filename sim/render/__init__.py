"""What a camera sees: views of a mesh as colour, planar depth and object ids, and single rays."""
