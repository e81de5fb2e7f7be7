"""`python -m soak WHAT`: run a trial many times, print its rows, and end with status 1 where something was wrong."""

import argparse
import json
import secrets
import sys
from math import inf
from pathlib import Path

from perfanim.core.solver.settings import METHODS

from . import cameras, sessions, takes, trackers, writes
from .processes import Row

_DAY = 24 * 3600 * 60  # frames
_SOAKS = {  # trial, its usual count, and what is counted
    "takes": (takes.rows, 100, "captures of which a process is killed or frozen"),
    "writes": (writes.rows, 1000, "writing processes that are killed, or get no more disk"),
    "trackers": (trackers.rows, 60, "seconds of each kind of flood"),
    "cameras": (cameras.rows, 20, "failures of each kind"),
    "session": (sessions.rows, _DAY, "frames of a capture without an end (24 hours)"),
}


def main() -> int:
    """Run; the exit status is 1 when anything that must hold did not."""
    parser = argparse.ArgumentParser(prog="soak", description=__doc__)
    commands = parser.add_subparsers(dest="what", required=True)
    for name, (_, count, text) in _SOAKS.items():
        command = commands.add_parser(name, help=text, description=f"COUNT: {text}.")
        command.add_argument("--count", type=int, default=count, help=f"{text} (default {count})")
        command.add_argument("--seed", type=int, default=None, help="of chance (default: another at every run)")
        command.add_argument("--out", type=Path, help="report to write (JSON)")
        if name == "session":
            command.add_argument("--minutes", type=float, default=inf, help="that it runs at most")
            command.add_argument("--method", choices=METHODS, default="best", help="of the solver (default best)")
    options = parser.parse_args()
    seed = secrets.randbits(32) if options.seed is None else options.seed
    more = {"method": options.method, "seconds": 60.0 * options.minutes} if options.what == "session" else {}
    rows: list[Row] = []
    for row in _SOAKS[options.what][0](options.count, seed, **more):
        rows.append(row)
        sys.stdout.write(f"{len(rows)}: {_line(row)}\n")
        sys.stdout.flush()
    wrong = sum(bool(row["wrong"]) for row in rows)
    if options.out:
        options.out.write_text(json.dumps({"seed": seed, "rows": rows}, indent=1))
    for name, values in _figures(rows).items():
        sys.stdout.write(f"{name}: median {sorted(values)[len(values) // 2]:.4g}, most {max(values):.4g}\n")
    sys.stdout.write(f"{wrong} of {len(rows)} wrong; seed {seed}\n")
    return int(wrong > 0)


def _line(row: Row) -> str:
    return ", ".join(
        f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}" for name, value in row.items()
    )


def _figures(rows: list[Row]) -> dict[str, list[float]]:
    """Return the numbers of all rows by name."""
    found: dict[str, list[float]] = {}
    for row in rows:
        for name, value in row.items():
            if isinstance(value, float):
                found.setdefault(name, []).append(value)
    return found


if __name__ == "__main__":
    sys.exit(main())
