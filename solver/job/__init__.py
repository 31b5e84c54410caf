"""The job folder: the only thing that Blender and the solver share."""
