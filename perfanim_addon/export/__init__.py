"""Files written by Blender."""
