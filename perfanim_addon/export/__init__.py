"""Export of files by Blender."""
