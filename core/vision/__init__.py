"""From images to marker frames."""
