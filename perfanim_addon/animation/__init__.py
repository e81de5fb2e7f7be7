"""Actions and their keyframes."""
