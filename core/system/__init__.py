"""Files, shipped assets, libraries, clocks and helper processes."""
