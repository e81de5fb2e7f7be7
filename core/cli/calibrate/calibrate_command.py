"""`perfanim calibrate`: its subcommands."""

from typing import Any

from . import board, cameras, floor, prop, refine, subject


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("calibrate", help="calibrate cameras, a subject or a prop, print a board")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    for subcommand in (cameras, board, subject, prop, floor, refine):
        subcommand.add_parser(group)
