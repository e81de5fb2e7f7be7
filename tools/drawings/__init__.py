"""Drawings of the documents, computed from marker sets and cameras."""
