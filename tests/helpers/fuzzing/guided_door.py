"""`python -m fuzzing.guided_door`: one door, with libFuzzer.

Arguments: door, file for results, folder for inputs of faults; the rest is libFuzzer's. It ends the process, so the
figures are written after each input.
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["perfanim"]):
    from .doors import all_doors
    from .limits import limited_memory, outcome_of


def main() -> None:
    """Run until libFuzzer ends the process."""
    name, results, out, *arguments = sys.argv[1:]
    folder = Path(tempfile.mkdtemp(dir=Path(results).parent))
    with atheris.instrument_imports(include=["perfanim"]):
        door = next(door for door in all_doors(folder) if door.name == name)
        for data in (*door.corpus, *door.guided):  # readers import what they need when they need it
            outcome_of(door, data)
    count, faults = 0, Counter[str]()
    with limited_memory(), Path(results).open("w") as file:

        def read(data: bytes) -> None:
            nonlocal count
            fault = outcome_of(door, data).fault
            if fault and fault not in faults:
                (Path(out) / f"{name.replace(' ', '-')}-guided-{len(faults)}.bin").write_bytes(data)
            count += 1
            faults.update([fault] if fault else ())
            file.seek(0)
            file.write(json.dumps([count, faults]))
            file.truncate()
            file.flush()

        atheris.Setup([sys.argv[0], *arguments], read)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
