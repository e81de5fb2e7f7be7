"""`python -m operator_fuzz.inside`: run sequences in this process.

It writes a line of JSON for each sequence to a file, and the steps of the current one, so that they survive a crash.
"""

import argparse
import json
import os
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any, TextIO

import bpy  # noqa: F401 - before `addon_utils`, which it brings

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))

from extension_folder import use_user_folder
from remains import remains

from .errors import errors_in
from .sequence import begin, clear, end, left_over, steps_of, take_step


def main() -> None:
    """Run the sequences."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int)
    parser.add_argument("--first", type=int)
    parser.add_argument("--stop", type=int)
    parser.add_argument("--until", type=float, help="of time.time")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    folder = options.folder
    (folder / "tmp").mkdir()
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "tmp")
    use_user_folder(folder / "user")
    with (folder / "said").open("w+b") as said, (folder / "results").open("w") as results:
        for number in (1, 2):
            os.dup2(said.fileno(), number)
        clear()
        begin(folder)
        end()
        before = remains()
        for number in range(options.first, options.stop):
            if time.time() > options.until:
                break
            results.write(json.dumps({"number": number, **_run(options.seed, number, before, folder)}) + "\n")
            results.flush()


def _run(seed: int, number: int, before: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run one sequence; return its steps, and its faults."""
    said = (folder / "said").stat().st_size
    faults, lines = [], []
    with (folder / "steps").open("w") as journal:
        try:
            clear()
            begin(folder)
            chance, steps = steps_of(seed, number)
            for step in steps:
                _note(journal, step.__name__)
                lines.append(take_step(step, chance, folder))
                _note(journal, lines[-1])
            _note(journal, "end")
            end()
        except Exception:  # any exception is a fault
            faults.append(traceback.format_exc()[-1500:])
            end()
    with (folder / "said").open(errors="replace") as file:
        file.seek(said)
        text = file.read()
    faults += errors_in(text)
    faults += left_over(before, folder)
    return {"faults": faults, "steps": lines if faults else len(lines)}


def _note(journal: TextIO, line: str) -> None:
    journal.write(line + "\n")
    journal.flush()


if __name__ == "__main__":
    main()
