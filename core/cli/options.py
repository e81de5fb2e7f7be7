"""Kinds of option values that several commands share."""

import argparse


def seed(text: str) -> int:
    """Return a seed: a whole number from 0."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0")
    return number
