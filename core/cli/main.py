"""The `perfanim` command: parse, run one command, print its summary.

Exit status: 0 done; 1 bad input or failed work (one line on stderr); 2 wrong usage; 130 interrupted; 141 nobody
reads the output, as of any program in a pipe.
"""

import argparse
import io
import json
import math
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TextIO

from .. import __version__
from ..errors import MOST_TEXT, PerfanimError, shorten
from .guarded_run import guarded_run
from .partial_result import PartialResult

# The module NAME_command has add_parser(subparsers), which sets `run`: (args, progress) -> summary or `PartialResult`.
COMMANDS = (
    "demo", "check", "calibrate", "track", "take", "database", "solve", "sketch", "evaluate", "retarget", "vmc",
    "batch", "simulate", "bench", "diagnose",
)  # fmt: skip
_PACKAGES = ("calibrate", "take", "batch")  # commands with a package of their own

# The solver's matrices are small: threads cost more than they gain, most of all beside other processes.
# Read by numpy's libraries when they are loaded, which is not before a command is chosen.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
# OpenCV and its video reader would write their own lines beside ours.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_NOBODY_READS = 128 + 13  # as shells tell the end by SIGPIPE
_MOST_PARTS = 12
_MOST_ROWS = 60  # of a report that are printed


class Progress:
    """Shows how far long work is, on stderr and only on a terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()
        self._width = 0

    def __call__(self, fraction: float, text: str) -> None:
        """Show `fraction` (0 to 1) and the activity."""
        if self._shown:
            line = f"{fraction:4.0%} {text}"
            sys.stderr.write("\r" + line.ljust(self._width))
            sys.stderr.flush()
            self._width = len(line)

    def clear(self) -> None:
        """Remove the line."""
        if self._shown and self._width:
            sys.stderr.write("\r" + " " * self._width + "\r")
            sys.stderr.flush()


class _Parser(argparse.ArgumentParser):
    """A parser, also of each command, with short messages on one line."""

    def error(self, message: str) -> NoReturn:
        """End with exit status 2 and a message of limited length."""
        super().error(shorten(message, MOST_TEXT - len(f"{self.prog}: error: ")))


def build_parser(commands: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser of the named commands, without importing the others."""
    parser = _Parser(prog="perfanim", description="Full-body performance animation from a few markers and two cameras.")
    parser.add_argument("--version", action="version", version=f"perfanim {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name in commands:
        # one command's module: the others' take a second to load
        folder = f".{name}" if name in _PACKAGES else ""
        import_module(f"{folder}.{name}_command", __package__).add_parser(subparsers)
    _add_json_option(parser)
    return parser


def _add_json_option(parser: argparse.ArgumentParser) -> None:
    """Give every command that runs something the --json option."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in set(action.choices.values()):
                _add_json_option(child)
    if parser.get_default("run") is not None:
        parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # a stream that the caller closed; else the next file that is opened would be it for libraries in C
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the end
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the end
    try:
        try:
            return _run(argv)
        finally:
            sys.stdout.flush()  # what --help printed, too, so that no error is left for Python's own end
    except BrokenPipeError:
        _forget(sys.stdout)
        _forget(sys.stderr)
        return _NOBODY_READS
    except OSError as error:
        _forget(sys.stdout)
        sys.stderr.write(f"perfanim: the output cannot be written ({error.strerror})\n")
        return 1


def _forget(stream: TextIO) -> None:
    """Let the unwritten rest of a stream go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _run(argv: Sequence[str] | None) -> int:
    given = sys.argv[1:] if argv is None else argv
    args = build_parser(given[:1] if given and given[0] in COMMANDS else COMMANDS).parse_args(given)
    progress = Progress()
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may be no text
        sys.stdout.reconfigure(errors="backslashreplace")
    # SIGTERM ends like any error: half-written files are removed on the way out
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        summary = guarded_run(args, progress)
    except (PerfanimError, OSError, MemoryError, UnicodeError) as error:
        progress.clear()
        own = error if isinstance(error, PerfanimError) else PerfanimError(f"failed ({error or 'out of memory'})")
        sys.stderr.write("perfanim: " + " ".join(str(own).split()) + "\n")
        return 1
    except KeyboardInterrupt:
        progress.clear()
        sys.stderr.write("perfanim: interrupted\n")
        return 130
    progress.clear()
    text = summary.text if isinstance(summary, PartialResult) else summary_text(summary)
    sys.stdout.write((json.dumps(jsonable(summary)) if args.json else text) + "\n")
    if isinstance(summary, PartialResult) and summary.failure:
        sys.stdout.flush()
        sys.stderr.write(f"perfanim: {summary.failure}\n")
        return 1
    return 0


def jsonable(value: Any) -> Any:
    """Return the value with numpy scalars and arrays as plain ones and NaN as null."""
    if isinstance(value, dict):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


def summary_text(summary: dict[str, Any]) -> str:
    """Return the summary for a person, a line for each figure.

    Long lists and tables are counted, not printed.

    Rows of a report (lists or tables of dicts) get a line each, up to `_MOST_ROWS`.
    """
    lines = []
    for key, value in jsonable(summary).items():
        label = key.replace("_", " ")
        if isinstance(value, float):
            lines.append(f"{label}: {value:.4g}")
        elif isinstance(value, dict | list) and not value:
            lines.append(f"{label}: none")
        elif isinstance(value, dict) and all(isinstance(row, dict) for row in value.values()):
            lines.append(f"{label}:")
            lines += _rows([f"{name}: {_short(row)}" for name, row in value.items()])
        elif isinstance(value, dict):
            parts = [f"{k} {_short(v)}" for k, v in list(value.items())[:_MOST_PARTS]]
            more = [f"and {len(value) - _MOST_PARTS} more, see --json"] if len(value) > _MOST_PARTS else []
            lines.append(f"{label}: " + ", ".join([*parts, *more]))
        elif isinstance(value, list) and all(isinstance(row, dict) for row in value):
            lines.append(f"{label}: {len(value)}")
            lines += _rows([", ".join(_row_value(*item) for item in row.items() if _is_said(item[1])) for row in value])
        elif isinstance(value, list):
            lines.append(f"{label}: {len(value)}" if len(value) > 12 else f"{label}: {', '.join(map(_short, value))}")
        else:
            lines.append(f"{label}: {value}")
    return "\n".join(lines)


def _rows(rows: list[str]) -> list[str]:
    shown = [f"  {row}" for row in rows[:_MOST_ROWS]]
    return [*shown, f"  and {len(rows) - _MOST_ROWS} more, see --json"] if len(rows) > _MOST_ROWS else shown


def _is_said(value: Any) -> bool:
    """Return whether a value of a row says anything; a moment of zero does."""
    return bool(value) or isinstance(value, float)


def _row_value(key: str, value: Any) -> str:
    """Return a value of a row; a number with a fraction gets its name."""
    return f"{key.replace('_', ' ')} {_short(value)}" if isinstance(value, float) else str(value)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return " ".join(f"{key}={_short(item)}" for key, item in value.items() if item is not None)
    return str(value)


if __name__ == "__main__":
    sys.exit(main())
