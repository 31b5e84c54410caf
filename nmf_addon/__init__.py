"""The Blender side: registration, preferences, panel, jobs and what they do to a scene."""
