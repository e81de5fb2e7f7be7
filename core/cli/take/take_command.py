"""`perfanim take`: its subcommands."""

from typing import Any

from ..options import add_group
from . import export_take, fill_take, import_takes, recover_take, take_info


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "take", "recorded takes: facts, recover, import, fill, export")
    for subcommand in (take_info, recover_take, import_takes, fill_take, export_take):
        subcommand.add_parser(group)
