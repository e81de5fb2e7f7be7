"""Setup check: faults of cameras, light and markers, found before a capture."""
