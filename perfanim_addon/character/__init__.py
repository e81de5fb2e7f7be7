"""Characters: armatures to drive, and our own character."""
