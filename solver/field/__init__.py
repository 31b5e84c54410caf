"""What is unknown about the object: density, normals and materials in a box."""
