"""Image sources: cameras, videos and image files."""
