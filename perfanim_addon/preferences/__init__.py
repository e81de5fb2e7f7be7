"""Preferences, folders, translations and diagnostics."""
