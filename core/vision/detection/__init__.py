"""Find marker blobs in an image."""
