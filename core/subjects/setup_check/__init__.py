"""Check of cameras, light and markers before a capture."""
