"""Drawing in the 3D viewport and in the camera preview."""
