"""System services: files, shipped assets, libraries, clocks and helper processes."""
