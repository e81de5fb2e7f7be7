"""`perfanim calibrate`: its subcommands."""

from typing import Any

from ..options import add_group
from . import calibrate_cameras, calibrate_floor, calibrate_prop, calibrate_subject, refine_cameras


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "calibrate", "calibrate cameras, a subject or a prop, print a board")
    for subcommand in (calibrate_cameras, calibrate_subject, calibrate_prop, calibrate_floor, refine_cameras):
        subcommand.add_parser(group)
