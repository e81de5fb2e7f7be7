"""`python -m operator_fuzz`: run sequences, a few hundred per process."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_AT_ONCE = 200  # sequences per process
_HUNG_S = 600.0


def main() -> int:
    """Run the sequences; the exit status is 1 if there were faults."""
    parser = argparse.ArgumentParser(prog="operator_fuzz", description="Random steps in Blender, with the add-on.")
    parser.add_argument("--sequences", type=int, default=1000, help="number of sequences (default 1000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first sequence, to repeat it (default 0)")
    parser.add_argument("--seconds", type=float, default=1e9, help="end after this time (default: all sequences)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the steps (default 1)")
    parser.add_argument("--window", action="store_true", help="run in a window, while a capture is live; needs BLENDER")
    options = parser.parse_args()
    stop, until_s = options.first + options.sequences, time.time() + options.seconds
    count = steps = faulty = 0
    if options.window:
        from .window import run_window as run
    else:
        run = run_headless
    for result in run(options.seed, options.first, stop, until_s):
        count += 1
        if result["faults"]:
            faulty += 1
            sys.stdout.write(f"sequence {result['number']}:\n" + "\n".join(result["faults"]) + "\n")
            sys.stdout.write("".join(f"  {line}\n" for line in result["steps"]))
            sys.stdout.flush()
        else:
            steps += result["steps"]
    sys.stdout.write(f"{count} sequences, {faulty} with faults, {steps} steps in the others\n")
    return 1 if faulty else 0


def run_headless(seed: int, first: int, stop: int, until_s: float) -> Iterator[dict[str, Any]]:
    """Yield the result of each sequence; a crash counts as one."""
    at = first
    while at < stop and time.time() < until_s:
        with tempfile.TemporaryDirectory(prefix="operator-fuzz-") as name:
            folder = Path(name)
            last = min(at + _AT_ONCE, stop)
            numbers = ["--first", str(at), "--stop", str(last), "--until", str(until_s)]
            command = [sys.executable, "-m", "operator_fuzz.inside", "--seed", str(seed), *numbers, "--folder", name]
            with (folder / "output").open("wb") as output:
                try:
                    status: object = subprocess.run(
                        command,
                        cwd=folder,  # for relative paths
                        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
                        timeout=_HUNG_S,
                        stdout=output,
                        stderr=output,
                    ).returncode
                except subprocess.TimeoutExpired:
                    status = "hangs"
            results = folder / "results"
            for line in results.read_text().splitlines() if results.is_file() else ():
                result = json.loads(line)
                at = result["number"] + 1
                yield result
            if status:
                said = "".join(
                    path.read_text(errors="replace")[-1500:]
                    for path in (folder / "said", folder / "output")
                    if path.is_file()
                )
                steps = (folder / "steps").read_text().splitlines() if (folder / "steps").is_file() else []
                yield {"number": at, "faults": [f"the process ended with {status}: {said}"], "steps": steps}
                at += 1


if __name__ == "__main__":
    sys.exit(main())
