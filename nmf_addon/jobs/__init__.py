"""Jobs: a solver process per job, watched without blocking Blender."""
