"""`perfanim calibrate`: its subcommands."""

from typing import Any

from . import (
    calibrate_board,
    calibrate_cameras,
    calibrate_floor,
    calibrate_prop,
    calibrate_refine,
    calibrate_subject,
)


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("calibrate", help="calibrate cameras, a subject or a prop, print a board")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    for subcommand in (
        calibrate_cameras,
        calibrate_board,
        calibrate_subject,
        calibrate_prop,
        calibrate_floor,
        calibrate_refine,
    ):
        subcommand.add_parser(group)
