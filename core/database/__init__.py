"""Motion databases: building, storing and opening them."""
