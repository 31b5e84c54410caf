"""What leaves: a mesh with textures, the light, and a report."""
