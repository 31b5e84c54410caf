"""Cameras and photos in: readers, the neutral `Capture`, and all axis conventions.

Only `photos` (with `decoding` and `masks`) needs more than numpy and the standard library: Blender
imports the rest, too.
"""
