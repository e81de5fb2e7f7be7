"""Generator of the character's mesh: implicit surfaces around the bones, and skin weights."""
