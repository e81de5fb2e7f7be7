"""Worker: the processes next to Blender that run cameras, solver and jobs."""
