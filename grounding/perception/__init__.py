"""What cuts views into things and says what they are; oracle perception, as wrong as it is told."""
