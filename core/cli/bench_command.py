"""`perfanim bench`: benchmarks of a source checkout (tools/bench).

They are not part of the wheel or the extension.
"""

import argparse
import sys
from typing import Any

from .. import PACKAGE_ROOT
from ..errors import SettingsError

_TOOLS = PACKAGE_ROOT / "tools"


def add_parser(subparsers: Any) -> None:
    if (_TOOLS / "bench").is_dir():
        if str(_TOOLS) not in sys.path:
            sys.path.append(str(_TOOLS))
        from bench import command

        command.add_parser(subparsers)
    else:
        parser = subparsers.add_parser("bench", help="benchmarks; only in a source checkout")
        parser.add_argument("arguments", nargs=argparse.REMAINDER)
        parser.set_defaults(run=_refuse)


def _refuse(args: argparse.Namespace, progress: object) -> dict[str, Any]:
    raise SettingsError("benchmarks are not installed", advice="run them in a source checkout")
