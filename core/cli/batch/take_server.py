"""Processing a batch's takes in another process (`serve`) or on a cluster (`serve_task`)."""

import os
import queue
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from io import StringIO
from typing import TYPE_CHECKING, Any

from ...formats.markers.marker_files import is_recorded
from ...system.progress import no_progress

if TYPE_CHECKING:
    import argparse

    from ...session.solved_take import SolvedTake

_local = threading.local()


def serve_task(text: str) -> str:
    """Process one take; task and record are JSON (`take_record.Task`, `Record`).

    Each thread opens a database once for all of its takes.
    """
    from .process_take import run_task
    from .take_record import Task

    if not hasattr(_local, "commands"):
        _local.commands = CommandLine()
    return run_task(Task.of_text(text), _local.commands).text()


class CommandLine:
    """Runs the commands for a take in this process, with a session cache shared between takes."""

    def __init__(self) -> None:
        import cv2

        from ...session.session_cache import SessionCache

        cv2.setNumThreads(1)  # there is one process per core
        self._store = SessionCache()

    def run(self, command: str, options: Sequence[str]) -> dict[str, Any]:
        """Run a command and return its summary."""
        args = parse_options(command, options)
        with _usage_as_settings_error():
            summary: dict[str, Any] = args.run(args, no_progress)
        return summary

    def solve(self, options: Sequence[str]) -> "tuple[SolvedTake, dict[str, Any]]":
        """Run `perfanim solve`; return poses, motion and facts."""
        from ..solve_command import solve

        args = parse_options("solve", options)
        with _usage_as_settings_error():
            solved = solve(args, no_progress, self._store)
        return solved, solved.report


def parse_options(command: str, options: Sequence[str]) -> "argparse.Namespace":
    """Return the options of a command; SettingsError for wrong usage."""
    from .. import solve_command
    from ..main import build_parser

    with _usage_as_settings_error():
        args = build_parser([command]).parse_args([command, *options])
        if command == "solve":
            solve_command.check(args)
            # several workers would build the starter database at the same time
            if args.database is None and not is_recorded(args.take):
                args.wrong_usage("the following arguments are required: --database")
    return args


@contextmanager
def _usage_as_settings_error() -> Iterator[None]:
    """Raise SettingsError where the command line would exit for wrong usage."""
    from ...errors import SettingsError

    written = StringIO()
    try:
        with redirect_stderr(written):
            yield
    except SystemExit as error:
        if error.code != 2:  # not an exit for wrong usage
            raise
        line = written.getvalue().strip().splitlines()[-1]
        raise SettingsError(line.rpartition("error: ")[2]) from None


def serve() -> None:
    """Process the takes that standard input names; write the records to standard output."""
    # output of libraries must not appear between the answers
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    requests: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    while True:
        answers.write(serve_task(requests.get()) + "\n")
        answers.flush()


def _listen(requests: queue.SimpleQueue[str]) -> None:
    """Queue the requests; end this process as soon as their sender is gone."""
    for line in sys.stdin:
        requests.put(line)
    os._exit(0)
