"""Walks of a technical director and a developer, each with a page of its steps."""
