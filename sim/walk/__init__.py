"""Places where a robot can stand, their distances and their views: floor grids and Habitat's navigation meshes."""
