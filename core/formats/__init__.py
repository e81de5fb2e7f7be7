"""Our own and other programs' files: motion and marker takes."""
