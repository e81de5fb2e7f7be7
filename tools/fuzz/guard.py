"""Guarded runs of many inputs in a child process, with their time and memory."""

import json
import os
import random
import resource
import select
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from perfanim.core.errors import MOST_TEXT, PerfanimError

from .doors import Door

_HUNG_S = 20.0
_MOST_TIMES = 4  # memory by the bytes of an input
_MORE_BYTES = 4 << 30  # that a child may ask for; then it gets MemoryError, before the machine suffers
_INPUTS_A_CHILD = 500


@dataclass
class Row:
    """Figures of one door.

    Args:
        faults: place or reason -> numbers of the inputs with it.
    """

    door: str
    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    slowest_s: float = 0.0
    most_bytes: int = 0
    faults: dict[str, list[int]] = field(default_factory=dict)

    def add(self, number: int, result: dict[str, Any]) -> None:
        """Count the result of an input."""
        self.inputs += 1
        self.slowest_s = max(self.slowest_s, result.get("seconds", 0.0))
        self.most_bytes = max(self.most_bytes, result.get("bytes", 0))
        if result["end"] in ("refused", "accepted"):
            setattr(self, result["end"], getattr(self, result["end"]) + 1)
        else:
            self.faults.setdefault(result["end"], []).append(number)

    def join(self, other: "Row") -> None:
        """Add the figures of more inputs."""
        self.inputs, self.refused = self.inputs + other.inputs, self.refused + other.refused
        self.accepted += other.accepted
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.most_bytes = max(self.most_bytes, other.most_bytes)
        for fault, numbers in other.faults.items():
            self.faults.setdefault(fault, []).extend(numbers)


def changed_input(door: Door, seed: int, number: int) -> bytes:
    """Return the input of this number; corpus and guided inputs come first."""
    if number < len(door.corpus) + len(door.guided):
        return (*door.corpus, *door.guided)[number]
    chance = random.Random(f"{seed}/{door.name}/{number}")  # noqa: S311 - repeatable, no secret
    return door.change(chance, chance.choice(door.corpus))


def run_door(door: Door, seed: int, numbers: range, until_s: float) -> Row:
    """Return the figures of a door after all inputs, or at `until_s`.

    Args:
        until_s: of `time.monotonic`.
    """
    row, at = Row(door.name), numbers.start
    while at < numbers.stop and time.monotonic() < until_s:
        for result in _run_child(door, seed, range(at, min(at + _INPUTS_A_CHILD, numbers.stop)), until_s):
            row.add(at, result)
            at += 1
    return row


def _run_child(door: Door, seed: int, numbers: range, until_s: float) -> Iterator[dict[str, Any]]:
    """Yield one result an input.

    A child that ends or hangs gives its input the fault, and no further ones.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number in (1, 2):  # libraries in C write there what they think of the files
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        status = 1
        limit_memory()
        try:
            with os.fdopen(writing, "wb") as output:
                for number in numbers:
                    if time.monotonic() > until_s:
                        break
                    output.write(json.dumps(result_of(door, changed_input(door, seed, number))).encode() + b"\n")
                    output.flush()
            status = 0
        finally:
            os._exit(status)
    os.close(writing)
    with os.fdopen(reading, "rb", buffering=0) as answers:  # `select` sees no buffer
        for _ in numbers:
            came, _, _ = select.select([answers], [], [], _HUNG_S)
            line = answers.readline() if came else b""
            if not line:
                if not came:
                    os.kill(child, 9)
                _, status = os.waitpid(child, 0)
                if status:
                    yield {"end": f"the process ended with status {status}" if came else "it hangs"}
                return
            yield json.loads(line)
    os.waitpid(child, 0)


def limit_memory() -> None:
    """Let this process have no more than some memory beyond its present use."""
    most = _memory("VmSize:") + _MORE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def result_of(door: Door, data: bytes) -> dict[str, Any]:
    """Read an input in this process; return how it ended, with time and memory."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins at the present use
    before = _memory("VmRSS:")
    begun_s = time.process_time()  # of the processor: a busy machine is no fault of the reader
    try:
        door.read(data)
        end = "accepted"
    except PerfanimError as error:
        end = (
            "refused"
            if len(str(error)) <= MOST_TEXT and "\n" not in str(error)
            else "a message too long, or of several lines"
        )
    except SystemExit as stop:  # argparse
        end = "refused" if stop.code in (0, 2) else f"exit status {stop.code}"
    except BaseException as error:  # all else is a fault
        end = f"{type(error).__name__} in {_place(error)}"
    seconds = time.process_time() - begun_s
    taken = max(_memory("VmHWM:") - before, 0)
    if end in ("accepted", "refused"):
        if seconds > door.longest_s:
            end = f"more than {door.longest_s:g} s"
        elif taken > _MOST_TIMES * len(data) + door.slack_bytes:
            end = f"more memory than {_MOST_TIMES} times the input and {door.slack_bytes >> 20} MB"
    return {"end": end, "seconds": seconds, "bytes": taken}


def _memory(key: str) -> int:
    """Return bytes of /proc/self/status."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(key))


def _place(error: BaseException) -> str:
    """Return file and line of the deepest call of the project."""
    calls = [call for call in traceback.extract_tb(error.__traceback__) if "/core/" in call.filename]
    return f"{'/'.join(Path(calls[-1].filename).parts[-3:])}:{calls[-1].lineno}" if calls else "the fuzzer"
