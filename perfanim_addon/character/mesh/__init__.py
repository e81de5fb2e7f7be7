"""The character's mesh."""
