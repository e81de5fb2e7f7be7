"""`perfanim take`: its subcommands."""

from typing import Any

from . import export_take, fill_take, import_takes, recover_take, take_info


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("take", help="recorded takes: facts, recover, import, fill, export")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    for subcommand in (take_info, recover_take, import_takes, fill_take, export_take):
        subcommand.add_parser(group)
