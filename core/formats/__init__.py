"""Files of other programs and of our own: motion and marker takes."""
