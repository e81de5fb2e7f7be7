"""Generator of the character's mesh: surfaces around the bones, skin weights."""
