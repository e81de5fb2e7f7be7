"""Sketches in Blender: controls on a character, their keys, and the solved motion."""
