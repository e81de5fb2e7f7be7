"""The `perfanim` command: parse, run one command, print its summary.

Exit status: 0 done; 1 bad input or failed work (one line on stderr); 2 wrong usage; 130 interrupted; 141 the reader of
the output has gone, as for any program in a pipe.
"""

import argparse
import io
import json
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn, TextIO

from .. import __version__
from ..errors import MOST_TEXT, PerfanimError, fit_sentence
from .command_summary import PartialResult, jsonable, summary_text
from .output_guard import guarded_run

# The module NAME_command has add_parser(subparsers), which sets `run`: (args, progress) -> summary or `PartialResult`.
COMMANDS = (
    "demo", "check", "calibrate", "track", "take", "database", "solve", "sketch", "evaluate", "retarget", "vmc",
    "batch", "network", "simulate", "bench", "diagnose",
)  # fmt: skip
_PACKAGES = ("calibrate", "take", "batch")  # commands that are packages with a module NAME_command

# The solver's matrices are small: threads cost more than they gain, especially next to other processes. NumPy's
# libraries read this when they are loaded, which happens after a command is chosen.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Keep OpenCV and its video reader from printing messages of their own.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


class Progress:
    """Progress of long work, shown on stderr and only on a terminal."""

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
        """Remove the progress from the terminal."""
        if self._shown and self._width:
            sys.stderr.write("\r" + " " * self._width + "\r")
            sys.stderr.flush()


class _Parser(argparse.ArgumentParser):
    """Parser for the program and each command, with short one-line messages."""

    def error(self, message: str) -> NoReturn:
        """End with exit status 2 and a short one-line message, which a page of options would hide."""
        start, advice = f"{self.prog}: error: ", f" (usage: {self.prog} --help)"
        self.exit(2, start + fit_sentence(message, MOST_TEXT - len(start + advice)) + advice + "\n")


def build_parser(commands: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser for the named commands; the others, which take a second to load, are not imported."""
    parser = _Parser(prog="perfanim", description="Full-body performance animation from a few markers and two cameras.")
    parser.add_argument("--version", action="version", version=f"perfanim {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name in commands:
        folder = f".{name}" if name in _PACKAGES else ""
        import_module(f"{folder}.{name}_command", __package__).add_parser(subparsers)
    _add_json_option(parser)
    return parser


def _add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add --json to every command that runs something."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in set(action.choices.values()):
                _add_json_option(child)
    if parser.get_default("run") is not None:
        parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # otherwise C libraries would write into the next file that gets a closed stream's descriptor
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the end
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the end
    try:
        try:
            return _run(argv)
        finally:
            sys.stdout.flush()  # includes the output of --help: an error at Python's exit could not be handled
    except BrokenPipeError:
        _forget(sys.stdout)
        _forget(sys.stderr)
        return 128 + 13  # as shells report a program ended by SIGPIPE
    except OSError as error:
        _forget(sys.stdout)
        sys.stderr.write(f"perfanim: the output cannot be written ({error.strerror})\n")
        return 1


def _forget(stream: TextIO) -> None:
    """Discard what a stream has not written yet."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _run(argv: Sequence[str] | None) -> int:
    given = sys.argv[1:] if argv is None else argv
    args = build_parser(given[:1] if given and given[0] in COMMANDS else COMMANDS).parse_args(given)
    progress = Progress()
    if isinstance(sys.stdout, io.TextIOWrapper):  # file names need not be valid text
        sys.stdout.reconfigure(errors="backslashreplace")
    # turn SIGTERM into an exception, so that half-written files are removed
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        summary = guarded_run(args, progress)
    except (PerfanimError, OSError, MemoryError, UnicodeError) as error:
        progress.clear()
        own = error
        if not isinstance(error, PerfanimError):
            advice = "check the names of the files, and the free memory and disk space"
            own = PerfanimError(f"failed ({error or 'out of memory'})", advice=advice)
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


if __name__ == "__main__":
    sys.exit(main())
