"""Tasks done by several processes at once."""

import os
import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress

from ...system import helper_process
from .take_record import Record, Task, failed

# sums of several threads differ in their last bits, and the results of a batch must not
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def in_processes(serve: Callable[[], None], jobs: int, tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Yield what comes of tasks, as it comes.

    Args:
        serve: function at the top level of a module that serves tasks: a line of JSON each on standard
            input, a line of JSON each as answer.
        jobs: processes; one that dies is replaced, and its take is bad.
        tasks: in the order in which they are begun, but for those of one performer, which a process keeps.
    """
    open_tasks, records = _OpenTasks(tasks), queue.SimpleQueue[Record]()
    workers = [_Worker(serve) for _ in range(min(jobs, len(tasks)))]
    # a thread for each process hands it one take after another
    threads = [threading.Thread(target=_keep_busy, args=(worker, open_tasks, records)) for worker in workers]
    for thread in threads:
        thread.start()
    try:
        for _ in tasks:
            yield records.get()
    finally:
        open_tasks.clear()
        for worker in workers:
            worker.kill()
        for thread in threads:
            thread.join()


def _keep_busy(worker: "_Worker", open_tasks: "_OpenTasks", records: queue.SimpleQueue[Record]) -> None:
    """Have a process do takes until none is left."""
    task = open_tasks.after(None)
    while task is not None:
        records.put(worker.run(task))
        task = open_tasks.after(task)
    worker.close()


class _OpenTasks:
    """Takes that nobody has begun. Each process gets such as it did before, whose performer it has prepared."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._lock = threading.Lock()
        self._left: dict[tuple[str, ...], deque[Task]] = {}
        self._begun: set[tuple[str, ...]] = set()
        for task in tasks:
            self._left.setdefault(_kind(task), deque()).append(task)

    def after(self, last: Task | None) -> Task | None:
        """Return a task for the process that did `last`, None when none is left."""
        with self._lock:
            if not self._left:
                return None
            kind = _kind(last) if last is not None else None
            if kind not in self._left:
                # one that no process has begun, else that of which most are left
                kind = max(self._left, key=lambda kind: (kind not in self._begun, len(self._left[kind])))
            self._begun.add(kind)
            task = self._left[kind].popleft()
            if not self._left[kind]:
                del self._left[kind]
            return task

    def clear(self) -> None:
        """Forget those that are left."""
        with self._lock:
            self._left.clear()


def _kind(task: Task) -> tuple[str, ...]:
    return tuple(task.take.options_of("solve"))


class _Worker:
    """A process that does one task after another; when it dies, another takes its place."""

    def __init__(self, serve: Callable[[], None]) -> None:
        self._serve = serve
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._is_killed = False

    def run(self, task: Task) -> Record:
        """Return what comes of a task."""
        answer = ""
        try:
            process = self._started()
            if process.stdin is not None and process.stdout is not None:
                process.stdin.write(task.text() + "\n")
                process.stdin.flush()
                answer = process.stdout.readline()
        except OSError:  # it does not listen any more
            pass
        if answer:
            return Record.of_text(answer)
        self.close()
        return failed(task.take, "its process ended without a word: too little memory, or a fault of a library")

    def kill(self) -> None:
        """End the process for good, whatever it is doing; asked by another thread."""
        with self._lock:
            self._is_killed = True
            if self._process is not None:
                self._process.kill()

    def close(self) -> None:
        """End the process when nobody waits for it."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(OSError):  # a request that was not taken
                process.communicate()

    def _started(self) -> "subprocess.Popen[str]":
        with self._lock:
            if self._is_killed:
                raise BrokenPipeError
            if self._process is None:
                self._process = subprocess.Popen(
                    helper_process.command(sys.executable), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                    encoding="utf-8", env={**os.environ, **_ONE_THREAD},
                )  # fmt: skip
                if self._process.stdin is not None:
                    self._process.stdin.write(helper_process.order(self._serve) + "\n")
            return self._process
