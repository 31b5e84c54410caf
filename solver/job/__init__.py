"""The job folder: the only thing Blender and the solver share. Standard library alone."""
