"""Files of homes to meshes: glTF, PLY, OBJ, Basis textures, and HM3D's semantic annotations."""
