"""`python -m fuzzing.guided`: libFuzzer leads inputs to new branches of the readers.

    make fuzz GUIDED=yes SECONDS=600

Needs atheris (extra `fuzz`). What counts as a fault is as in `limits`.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from .doors import Door, all_doors
from .limits import outcome_of

GUIDED = (
    *("BVH", "C3D", "recorded take"),
    *("calibration", "subject", "marker set", "prop", "bone map", "names", "plan"),
)
_LARGEST = 1 << 16  # bytes of an input
_HUNG_S = 20
_TINY = 2048  # bytes of an input worth keeping
_MOST_KEPT = 6  # inputs of a door


class Guided(NamedTuple):
    """Result of one door.

    Args:
        reached: Branches of the code that the corpus reaches, and that all inputs reach.
        faults: Fault -> number of inputs with it.
        found: Inputs that reached new branches.
    """

    inputs: int
    reached: tuple[int, int]
    faults: dict[str, int]
    found: tuple[bytes, ...]


def main() -> int:
    """Run; the exit status is 1 when there were faults."""
    parser = argparse.ArgumentParser(prog="fuzzing.guided", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long, all doors together (default 60)")
    parser.add_argument("--seed", type=int, default=1, help="of the changes (default 1)")
    parser.add_argument("--door", action="append", choices=GUIDED, help="only this one; may be repeated")
    parser.add_argument(
        "--out", type=Path, default=Path("fuzz-faults"), help="folder for inputs of faults, and tiny ones"
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    failed = False
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        doors = [door for door in all_doors(Path(scratch)) if door.name in (options.door or GUIDED)]
        for door in doors:
            guided = run_guided(door, max(1, round(options.seconds / len(doors))), -1, options.seed, options.out)
            failed |= bool(guided.faults)
            branches = f"{guided.reached[0]} branches of the corpus, {guided.reached[1]} reached"
            sys.stdout.write(f"{door.name}: {guided.inputs} inputs, {branches}, faults: {guided.faults or 'none'}\n")
            sys.stdout.flush()
            for number, data in enumerate(further(door, guided.found)):
                (options.out / f"{door.name.lower().replace(' ', '-')}-{number}{door.ending}").write_bytes(data)
    return int(failed)


def run_guided(door: Door, seconds: int, inputs: int, seed: int, out: Path) -> Guided:
    """Run one door in a process of its own.

    Args:
        inputs: Number of inputs; -1 for as many as the time allows.
        out: Folder for inputs of faults.
    """
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        corpus, results = Path(name) / "corpus", Path(name) / "results"
        corpus.mkdir()
        known = (*door.corpus, *door.guided)
        for number, data in enumerate(known):
            (corpus / f"{number}").write_bytes(data)
        limits = [f"-max_total_time={seconds}", f"-runs={inputs}", f"-max_len={_LARGEST}", f"-timeout={_HUNG_S}"]
        rest = [f"-seed={seed}", "-rss_limit_mb=0", "-detect_leaks=0", f"-artifact_prefix={out.absolute()}/"]
        command = [sys.executable, "-m", "fuzzing.guided_door", door.name, str(results), str(out.absolute())]
        done = subprocess.run(
            [*command, *limits, *rest, str(corpus)],
            cwd=Path(__file__).parents[1],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        written = results.read_text() if results.is_file() else ""
        count, faults = json.loads(written) if written else (0, {})
        if done.returncode:
            faults[f"the process ended with {done.returncode}: {done.stderr[-1000:]}"] = 1
        reached = [int(branches) for branches in re.findall(r"cov: (\d+)", done.stderr)] or [0]
        found = {path.read_bytes() for path in corpus.iterdir()} - set(known)
        return Guided(count, (reached[0], reached[-1]), faults, tuple(sorted(found)))


def further(door: Door, found: Iterable[bytes]) -> list[bytes]:
    """Return tiny inputs that go beyond the corpus, the furthest first, by their steps from line to line."""
    known = set().union(*(steps_of(door, data) for data in (*door.corpus, *door.guided)))
    reached = {data: steps_of(door, data) for data in found if len(data) <= _TINY}
    kept: list[bytes] = []
    while reached and len(kept) < _MOST_KEPT:
        best = max(reached, key=lambda data: (len(reached[data] - known), -len(data), data))
        if reached[best] <= known:
            break
        kept.append(best)
        known |= reached.pop(best)
    return kept


def steps_of(door: Door, data: bytes) -> set[tuple[str, int, int]]:
    """Return the steps (file, line, next line) of the project that read an input."""
    steps: set[tuple[str, int, int]] = set()

    def enter(frame: FrameType, _event: str, _argument: object) -> Any:
        if "/core/" not in frame.f_code.co_filename:
            return None
        last = 0

        def follow(inner: FrameType, event: str, _argument: object) -> Any:
            nonlocal last
            if event == "line":
                steps.add((inner.f_code.co_filename, last, inner.f_lineno))
                last = inner.f_lineno
            return follow

        return follow

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        outcome_of(door, data)
    finally:
        sys.settrace(before)
    return steps


if __name__ == "__main__":
    sys.exit(main())
