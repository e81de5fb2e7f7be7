"""Vision: from images to marker frames."""
