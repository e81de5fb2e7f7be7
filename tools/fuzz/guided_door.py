"""`python -m fuzz.guided_door`: one door, with libFuzzer.

Arguments: door, file for results, folder for inputs of faults; the rest is libFuzzer's. It ends the process, so the
figures are written after each input.
"""

import dataclasses
import json
import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["perfanim"]):
    from .doors import Door, all_doors
    from .guard import Row, limit_memory, result_of

_OWN_CHANGES = 0.5  # share of the inputs that the door's grammar changes, and not libFuzzer


def main() -> None:
    """Run until libFuzzer ends the process."""
    name, results, faults, *arguments = sys.argv[1:]
    folder = Path(tempfile.mkdtemp(dir=Path(results).parent))
    with atheris.instrument_imports(include=["perfanim"]):
        door = next(door for door in all_doors(folder) if door.name == name)
        for data in (*door.corpus, *door.guided):  # readers import what they need when they need it
            result_of(door, data)
    limit_memory()
    row = Row(name)
    with Path(results).open("w") as file:

        def read(data: bytes) -> None:
            result = result_of(door, data)
            if result["end"] not in ("refused", "accepted", *row.faults):
                path = Path(faults) / f"{name.replace(' ', '-')}-guided-{len(row.faults)}.bin"
                path.write_bytes(data)
            row.add(row.inputs, result)
            file.seek(0)
            file.write(json.dumps(dataclasses.asdict(row)))
            file.truncate()
            file.flush()

        atheris.Setup([sys.argv[0], *arguments], read, custom_mutator=_mutator(door))
        atheris.Fuzz()


def _mutator(door: Door):  # type: ignore[no-untyped-def]
    def change(data: bytes, most: int, seed: int) -> bytes:
        chance = random.Random(seed)  # noqa: S311 - repeatable, no secret
        if chance.random() < _OWN_CHANGES:
            return door.change(chance, data)[:most]
        return bytes(atheris.Mutate(data, most))

    return change


if __name__ == "__main__":
    main()
