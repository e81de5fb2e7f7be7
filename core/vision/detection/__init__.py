"""Detection of marker blobs in an image."""
