"""`perfanim take`: its subcommands."""

from typing import Any

from . import export, fill, import_takes, info, recover


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("take", help="recorded takes: facts, recover, import, fill, export")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    for subcommand in (info, recover, import_takes, fill, export):
        subcommand.add_parser(group)
