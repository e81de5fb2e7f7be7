"""Files of other programs: motion and marker takes."""
