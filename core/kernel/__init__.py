"""Compiled bodies of the functions on which a frame spends its time, see docs/kernel.md."""
