"""Process of one worker; its output is kept for error messages."""

import contextlib
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO

from ..errors import CaptureError
from ..system import helper_process
from ..system.libraries import LIBRARIES
from . import process
from .worker_settings import WORKER


def library_paths() -> list[str]:
    """Return the library folders of this process, for the worker to import from."""
    folders: list[str] = []
    for name in LIBRARIES:
        spec = importlib.util.find_spec(name)
        for location in (spec.submodule_search_locations or []) if spec else []:
            folder = str(Path(location).parent)
            if folder not in folders:
                folders.append(folder)
    return folders


def _not_started(program: str, reason: str) -> CaptureError:
    advice = "reinstall Blender or set the worker's Python in the preferences"
    return CaptureError(f"could not be started ({reason})", where=program, advice=advice)


class ChildProcess:
    """A Python process that runs `process.main`.

    Args:
        python: Interpreter; by default that of this process. It must not be Blender's own executable.

    Raises:
        CaptureError: The process could not be started.
    """

    def __init__(self, port: int, token: str, job: str, python: str | None = None) -> None:
        program = python or sys.executable
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed in release)
        try:
            self._process = self._start(program)
        except OSError as error:
            self.release()
            raise _not_started(program, str(error.strerror)) from error
        try:
            self._send_order(port, token, job)
        except OSError as error:  # the process ended before it read its order
            self.end(WORKER.dying_s)
            reason = f"ended immediately with status {self.status}{self.last_line()}"
            self.release()
            raise _not_started(program, reason) from error

    def _start(self, python: str) -> "subprocess.Popen[bytes]":
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return subprocess.Popen(
            helper_process.command(python),
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=self._log,
            env=environment,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )

    def _send_order(self, port: int, token: str, job: str) -> None:
        order = helper_process.run_request(process.main, port, token, job, paths=library_paths())
        if self._process.stdin is not None:
            self._process.stdin.write(order.encode("utf-8") + b"\n")
            self._process.stdin.flush()

    @property
    def id(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status; None while the process runs."""
        return self._process.poll()

    def last_line(self) -> str:
        """Return ": " and the last line that the process printed; "" if there is none."""
        self._log.seek(0)
        lines = self._log.read().decode("utf-8", "replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    def end(self, grace_s: float) -> None:
        """Close the process's input; terminate the process after `grace_s`, and kill it if that fails."""
        self._close_input()
        for force in (self._process.terminate, self._process.kill):
            try:
                self._process.wait(timeout=grace_s)
                return
            except subprocess.TimeoutExpired:
                force()
        self._process.wait()

    def kill(self) -> None:
        """Kill the process and release it: a hung process does not respond to anything else."""
        self._close_input()
        self._process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=WORKER.dying_s)
        self.release()

    def release(self) -> None:
        """Remove the log; safe to call twice."""
        self._log.close()

    def _close_input(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):  # the buffer may contain bytes that the ended process has not read
                self._process.stdin.close()
