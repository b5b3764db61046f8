"""Reads files of homes as meshes: glTF, PLY, OBJ, Basis textures, and HM3D's semantic annotations."""
