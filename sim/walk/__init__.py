"""Where a robot can stand, how far it is, and what it sees from there: floor grids and Habitat's navigation meshes."""
