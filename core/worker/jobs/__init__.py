"""Jobs of worker processes, one module each."""
