"""Motion of the product's skeleton on any humanoid armature: which bone is which joint, and how it must turn."""
