"""Label and solve a stream of marker frames, live or recorded."""
