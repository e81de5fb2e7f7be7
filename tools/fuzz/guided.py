"""`python -m fuzz.guided`: changes of inputs that reach new branches.

    cd tools && python -m fuzz.guided --seconds 600 --seed 1 --out ../out/fuzz

Needs atheris (extra `fuzz`), which leads libFuzzer through Python. What counts as a fault is as in `fuzz.guard`.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from .__main__ import table
from .doors import Door, all_doors
from .guard import Row, result_of

GUIDED = (
    *("BVH", "C3D", "recorded take"),
    *("calibration", "subject", "marker set", "prop", "bone map", "names", "plan"),
)
_LARGEST = 1 << 16
_HUNG_S = 20
_TINY = 2048  # bytes of an input worth keeping
_MOST_KEPT = 6  # of a door


@dataclass(frozen=True)
class Guided:
    """Result of one door.

    Args:
        reached: branches of the code that the corpus reaches, and that all inputs reach.
        found: inputs that reached new ones.
    """

    row: Row
    reached: tuple[int, int]
    found: tuple[bytes, ...]


def main() -> int:
    """Run; the exit status is 1 when there were faults."""
    parser = argparse.ArgumentParser(prog="fuzz.guided", description="Lead damaged inputs to new branches of readers.")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long, all doors together (default 60)")
    parser.add_argument("--inputs", type=int, default=-1, help="inputs of a door (default: as the time allows)")
    parser.add_argument("--seed", type=int, default=1, help="of the changes (default 1)")
    parser.add_argument("--door", action="append", choices=GUIDED, help="only this one; may be repeated")
    parser.add_argument("--out", type=Path, default=Path("fuzz-faults"), help="folder for the input of each fault")
    parser.add_argument("--keep", type=Path, help="folder for tiny inputs that reach what the corpus does not")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        doors = [door for door in all_doors(Path(scratch)) if door.name in (options.door or GUIDED)]
        rows = []
        for door in doors:
            seconds = max(1, round(options.seconds / len(doors)))
            guided = run_guided(door, seconds, options.inputs, options.seed, options.out)
            rows.append(guided.row)
            sys.stdout.write(f"{door.name}: {guided.reached[0]} branches of the corpus, {guided.reached[1]} reached\n")
            sys.stdout.flush()
            if options.keep:
                options.keep.mkdir(parents=True, exist_ok=True)
                for number, data in enumerate(further(door, guided.found)):
                    name = f"{door.name.lower().replace(' ', '-')}-{number}{door.ending}"
                    (options.keep / name).write_bytes(data)
        sys.stdout.write(table(rows))
        for row in rows:
            sys.stdout.writelines(f"{row.door}: {fault} ({len(all_)})\n" for fault, all_ in row.faults.items())
    return 1 if any(row.faults for row in rows) else 0


def run_guided(door: Door, seconds: int, inputs: int, seed: int, out: Path) -> Guided:
    """Run one door in a process of its own.

    Args:
        inputs: -1 for as many as the time allows.
        out: folder for inputs of faults.
    """
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        corpus, results = Path(name) / "corpus", Path(name) / "results"
        corpus.mkdir()
        for number, data in enumerate((*door.corpus, *door.guided)):
            (corpus / f"{number}").write_bytes(data)
        limits = [f"-max_total_time={seconds}", f"-runs={inputs}", f"-max_len={_LARGEST}", f"-timeout={_HUNG_S}"]
        rest = [f"-seed={seed}", "-rss_limit_mb=0", "-detect_leaks=0", f"-artifact_prefix={out.absolute()}/"]
        command = [sys.executable, "-m", "fuzz.guided_door", door.name, str(results), str(out.absolute())]
        done = subprocess.run(
            [*command, *limits, *rest, str(corpus)],
            cwd=Path(__file__).parents[1],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        row = Row(**json.loads(results.read_text())) if results.is_file() and results.stat().st_size else Row(door.name)
        if done.returncode:
            row.faults[f"the process ended with {done.returncode}: {done.stderr[-1000:]}"] = [row.inputs]
        reached = [int(count) for count in re.findall(r"cov: (\d+)", done.stderr)] or [0]
        found = {path.read_bytes() for path in corpus.iterdir()} - {*door.corpus, *door.guided}
        return Guided(row, (reached[0], reached[-1]), tuple(sorted(found)))


def further(door: Door, found: Iterable[bytes]) -> list[bytes]:
    """Return tiny inputs that go beyond the corpus, the furthest first.

    What counts are steps from line to line.
    """
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
        result_of(door, data)
    finally:
        sys.settrace(before)
    return steps


if __name__ == "__main__":
    sys.exit(main())
