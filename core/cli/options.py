"""Options, and kinds of their values, that several commands share."""

import argparse
from typing import Any

from ..retarget.joint_naming import NAMINGS, OWN

_MOST_HZ = 1000.0


def seed(text: str) -> int:
    """Return a seed: a whole number from 0."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0")
    return number


def positive(text: str, most: float, unit: str) -> float:
    """Return a number above 0, up to `most`; `unit` goes into the error."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of {unit} above 0, up to {most:g}")
    return number


def rate_hz(text: str) -> float:
    """Return a rate in frames per second."""
    return positive(text, _MOST_HZ, "frames per second")


def add_motion_options(parser: Any, *, defaults: bool = True) -> None:
    """Add how a motion is written (see `motion_export.write_motion`).

    Args:
        defaults: False where options that are not given must differ from given ones.
    """
    units, naming = ("m", OWN) if defaults else (None, None)
    parser.add_argument("--units", choices=("m", "cm"), default=units, help="unit of a BVH file (default m)")
    parser.add_argument(
        "--naming",
        choices=tuple(NAMINGS),
        default=naming,
        help=f"names of the joints in BVH and CSV files (default {OWN}: the standard skeleton's)",
    )
    parser.add_argument(
        "--rate", type=rate_hz, metavar="HZ", help="frames per second of the motion (default: as it was recorded)"
    )
