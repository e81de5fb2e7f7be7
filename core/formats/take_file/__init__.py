"""Recorded takes: a file that is written while capturing and survives whatever happens; see docs/take-format.md."""
