"""Property groups stored in the scene."""
