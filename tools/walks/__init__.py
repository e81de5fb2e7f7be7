"""Walks of an animator, a technical director, a developer, with their pages."""
