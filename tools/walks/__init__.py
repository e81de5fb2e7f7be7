"""Walks of an animator, a technical director and a developer, each with a page of its steps."""
