"""Worker: the processes beside Blender that run the cameras, the solver and jobs."""
