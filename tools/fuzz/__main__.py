"""`python -m fuzz`: damaged inputs for all doors in turn, and a table by door."""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from .doors import all_doors
from .guard import Row, changed_input, run_door

_ROUND = 200  # inputs of a door before it is the next one's turn
_COLUMNS = ("door", "inputs", "refused", "accepted", "faults", "slowest (s)", "peak memory (MB)")


def main() -> int:
    """Run; the exit status is 1 when there were faults."""
    parser = argparse.ArgumentParser(prog="fuzz", description="Throw damaged inputs at all doors of the project.")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default 60)")
    parser.add_argument(
        "--inputs", type=int, default=1 << 40, help="inputs of a door with a whole share (default: as the time allows)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the changes (default 1); the same gives the same inputs"
    )
    parser.add_argument("--door", action="append", help="only this one; may be repeated")
    parser.add_argument("--out", type=Path, help="folder for the first input of each fault")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        doors = [door for door in all_doors(Path(name)) if not options.door or door.name in options.door]
        rows = {door.name: Row(door.name) for door in doors}
        until_s, start = time.monotonic() + options.seconds, 0
        while time.monotonic() < until_s and start < options.inputs:
            stop = min(start + _ROUND, options.inputs)
            for door in doors:
                numbers = range(round(door.share * start), round(door.share * stop))
                rows[door.name].join(run_door(door, options.seed, numbers, until_s))
            start = stop
        sys.stdout.write(table(list(rows.values())))
        for door in doors:
            for number, (fault, inputs) in enumerate(rows[door.name].faults.items()):
                sys.stdout.write(f"{door.name}: {fault} ({len(inputs)}, first: {inputs[0]})\n")
                if options.out:
                    options.out.mkdir(parents=True, exist_ok=True)
                    path = options.out / f"{door.name.replace(' ', '-')}-{number}.bin"
                    path.write_bytes(changed_input(door, options.seed, inputs[0]))
    return 1 if any(row.faults for row in rows.values()) else 0


def table(rows: list[Row]) -> str:
    """Return the figures as a Markdown table."""
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|---" * len(_COLUMNS) + "|"]
    for row in rows:
        faults = sum(map(len, row.faults.values()))
        values = (row.door, row.inputs, row.refused, row.accepted, faults)
        lines.append("| " + " | ".join(map(str, values)) + f" | {row.slowest_s:.2f} | {row.most_bytes / 2**20:.0f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
