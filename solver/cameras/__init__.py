"""Cameras solved from photos alone, with COLMAP's incremental structure from motion."""
