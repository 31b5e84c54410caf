"""Cameras and photos in: readers, the neutral `Capture`, and all axis conventions.

Only `photos` needs more than numpy and the standard library: Blender imports the rest, too.
"""
