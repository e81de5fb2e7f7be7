"""Helper process that answers requests, each a line of JSON."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from io import BufferedReader
from typing import IO, cast

from . import helper_process


class JsonProcess:
    """One helper process; every method except `kill` raises BrokenPipeError once the process has ended.

    Args:
        serve: Function at the top level of a module that reads requests until its input ends.
        environment: Variables in addition to those of this process.
    """

    def __init__(self, serve: Callable[[], None], environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            helper_process.command(sys.executable),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **(environment or {})},
        )
        self._input = cast(IO[bytes], self._process.stdin)
        self._output = cast(BufferedReader, self._process.stdout)
        with suppress(BrokenPipeError):  # the first request will fail, too
            self._send(helper_process.run_request(serve))

    def ask(self, request: str) -> str:
        """Send a line and return the line with the answer."""
        self._send(request)
        answer = self._output.readline()
        if not answer:
            raise BrokenPipeError
        return answer.decode("utf-8")

    def read(self, count: int) -> bytearray:
        """Return the `count` bytes that follow an answer."""
        data = bytearray(count)
        if self._output.readinto(data) != count:
            raise BrokenPipeError
        return data

    def _send(self, line: str) -> None:
        try:
            self._input.write(line.encode("utf-8") + b"\n")
            self._input.flush()
        except OSError:
            raise BrokenPipeError from None

    def kill(self) -> None:
        """End the process, even while another thread reads from it."""
        self._process.kill()

    def close(self) -> None:
        """End the process and release its pipes; no thread may be reading from it."""
        self._process.kill()
        with suppress(OSError):  # a request that was not read
            self._process.communicate()
