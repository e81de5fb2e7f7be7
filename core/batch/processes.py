"""Tasks done by several processes at once."""

import json
import os
import queue
import subprocess
import sys
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path

from .take import Record, Task, failed

# sums of several threads differ in their last bits, and the results of a batch must not
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_ROOT = Path(__file__).resolve().parents[2]


class _DiedError(Exception):
    """A process ended before it answered."""


def in_processes(script: Path, jobs: int, tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Yield what comes of tasks, as it comes.

    Args:
        script: Python file that serves tasks: a line of JSON each on standard input, a line of JSON each as answer;
            the first line tells the folder of the package and where Python finds what it imports.
        jobs: processes; one that dies is replaced, and its take is bad.
        tasks: in the order in which they are begun.
    """
    free: queue.SimpleQueue[_Worker | None] = queue.SimpleQueue()
    started: list[_Worker] = []
    for _ in range(jobs):
        free.put(None)

    def run(task: Task) -> Record:
        worker = free.get()
        try:
            if worker is None:
                worker = _Worker(script)
                started.append(worker)
            return worker.run(task)
        except _DiedError:
            worker = None
            return failed(task.take, "its process ended without a word: too little memory, or a fault of a library")
        finally:
            free.put(worker)

    # a thread for each process hands it one take after another
    pool = ThreadPoolExecutor(jobs)
    try:
        for future in as_completed([pool.submit(run, task) for task in tasks]):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in list(started):
            worker.kill()
        pool.shutdown()
        for worker in started:
            worker.close()


class _Worker:
    """A process that does one task after another."""

    def __init__(self, script: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8",
            env={**os.environ, **_ONE_THREAD},
        )  # fmt: skip
        self._send(json.dumps({"root": str(_ROOT), "paths": sys.path}))

    def _send(self, line: str) -> None:
        assert self._process.stdin is not None  # noqa: S101  # it was asked for
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
        except OSError:
            raise _DiedError from None

    def run(self, task: Task) -> Record:
        """Return what comes of a task."""
        assert self._process.stdout is not None  # noqa: S101  # it was asked for
        self._send(task.text())
        answer = self._process.stdout.readline()
        if not answer:
            raise _DiedError
        return Record.of_text(answer)

    def kill(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()

    def close(self) -> None:
        """Forget the process, once nobody reads from it."""
        with suppress(OSError):  # a request that was not taken
            self._process.communicate()
