"""Batch tasks in several processes at once."""

import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Sequence

from ...system.json_process import JsonProcess
from .take_record import Record, Task, failed_record

# sums over several threads differ in their last bits, but the results of a batch must not
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def in_processes(serve: Callable[[], None], jobs: int, tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Yield the records of tasks as they finish.

    Args:
        serve: Module-level function that processes tasks: it reads one line of JSON per task from standard input and
            writes one line of JSON per answer.
        jobs: Number of processes; one that dies is replaced, and its take counts as bad.
    """
    open_tasks, records = _OpenTasks(tasks), queue.SimpleQueue[Record]()
    workers = [_Worker(serve) for _ in range(min(jobs, len(tasks)))]
    # one thread per process hands it one take after another
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
    task = open_tasks.next_after(None)
    while task is not None:
        records.put(worker.run(task))
        task = open_tasks.next_after(task)
    worker.close()


class _OpenTasks:
    """Tasks that have not started, grouped by performer, because a process prepares each performer once."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._lock = threading.Lock()
        self._left: dict[tuple[str, ...], deque[Task]] = {}
        self._begun: set[tuple[str, ...]] = set()
        for task in tasks:
            self._left.setdefault(_performer(task), deque()).append(task)

    def next_after(self, last: Task | None) -> Task | None:
        """Return a task for a process whose previous task was `last`, or None if no task is left."""
        with self._lock:
            if not self._left:
                return None
            performer = _performer(last) if last is not None else None
            if performer not in self._left:
                # a performer that no process has started, else the one with the most tasks left
                performer = max(self._left, key=lambda each: (each not in self._begun, len(self._left[each])))
            self._begun.add(performer)
            task = self._left[performer].popleft()
            if not self._left[performer]:
                del self._left[performer]
            return task

    def clear(self) -> None:
        with self._lock:
            self._left.clear()


def _performer(task: Task) -> tuple[str, ...]:
    return tuple(task.take.options_of("solve"))


class _Worker:
    """Process that runs one task after another, and is replaced if it dies."""

    def __init__(self, serve: Callable[[], None]) -> None:
        self._serve = serve
        self._lock = threading.Lock()
        self._process: JsonProcess | None = None
        self._is_killed = False

    def run(self, task: Task) -> Record:
        try:
            return Record.of_text(self._running_process().ask(task.text()))
        except BrokenPipeError:
            self.close()
            reason = "its process ended without a message: it ran out of memory, or a library crashed"
            return failed_record(task.take, reason)

    def kill(self) -> None:
        """End the process for good; called from a thread other than that of `run`."""
        with self._lock:
            self._is_killed = True
            if self._process is not None:
                self._process.kill()

    def close(self) -> None:
        """End the process when it is no longer needed."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.close()

    def _running_process(self) -> JsonProcess:
        with self._lock:
            if self._is_killed:
                raise BrokenPipeError
            if self._process is None:
                self._process = JsonProcess(self._serve, _ONE_THREAD)
            return self._process
