"""The process that runs the cameras beside Blender."""
