"""Damaged inputs at every door of the project: a short run with a fixed seed, and that the fuzzer sees faults."""

import math
import os
import random
import re
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from fuzz import mutations
from fuzz.doors import Door, all_doors
from fuzz.guard import changed_input, run_door
from fuzz.guided import further
from fuzz.mutations import change_text, repeat_part
from perfanim.core.errors import FormatError

SEED = 7
INPUTS = {"image sources": 15, "marker frames": 25, "command line": 25}
USUAL_INPUTS = 60

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")


@pytest.fixture(scope="module")
def doors(tmp_path_factory):
    return {door.name: door for door in all_doors(tmp_path_factory.mktemp("doors"))}


def test_no_door_lets_damaged_input_do_harm(doors):
    for door in doors.values():
        inputs = max(INPUTS.get(door.name, USUAL_INPUTS), len(door.corpus) + len(door.guided))
        row = run_door(door, SEED, range(inputs), math.inf)
        assert row.faults == {}, f"{door.name}: python -m fuzz --door '{door.name}' --seed {SEED} --inputs {inputs}"
        assert row.inputs == row.refused + row.accepted == inputs
        if door.name != "VMC packets":  # a stream counts what it refuses
            assert row.refused, door.name
        assert row.accepted, door.name


def test_every_file_that_did_harm_is_thrown_again(doors):
    folder = Path(__file__).parents[1] / "fuzz"
    found = {path.read_bytes() for name in ("found", "guided") for path in (folder / name).iterdir()}
    assert found
    assert found <= {data for door in doors.values() for data in (*door.corpus, *door.guided)}


def test_an_input_that_goes_further_than_the_corpus_is_kept(doors):
    door = replace(doors["BVH"], corpus=(b"HIERARCHY\n",), guided=())
    joint = b"ROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
    whole = b"HIERARCHY\n" + joint + b"MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"
    assert further(door, [b"HIERARCHY\n", b"HIERARCHY \n", whole]) == [whole]
    assert further(door, [doors["BVH"].corpus[0]]) == [], "it is not tiny"


class TwoLineError(FormatError):
    """An error past the rules of its base."""

    def __str__(self) -> str:
        return "in\ntwo lines"


def harmful(data: bytes) -> None:
    kinds = {b"a": FormatError("is damaged"), b"b": KeyError("b"), b"c": TwoLineError("")}
    if data in kinds:
        raise kinds[data]
    if data == b"d":
        begun_s = time.process_time()
        while time.process_time() - begun_s < 0.3:
            pass
    if data == b"e":
        raise MemoryError
    if data == b"f":
        bytes(range(256)) * (1 << 20)


def test_the_fuzzer_sees_each_kind_of_fault():
    corpus = tuple(bytes([letter]) for letter in b"abcdeg")
    row = run_door(Door("a door", corpus, change_text, harmful, longest_s=0.2), SEED, range(6), math.inf)
    assert (row.inputs, row.refused, row.accepted) == (6, 1, 1)
    kinds = {numbers[0]: fault for fault, numbers in row.faults.items()}
    assert set(kinds) == {1, 2, 3, 4}
    assert kinds[1].startswith("KeyError")
    assert kinds[3] == "more than 0.2 s"
    assert kinds[4].startswith("MemoryError")
    row = run_door(Door("a door", (b"f",), change_text, harmful, longest_s=60.0), SEED, range(1), math.inf)
    assert row.faults == {"more memory than 4 times the input and 64 MB": [0]}


def test_a_child_that_dies_costs_one_input():
    def read(data: bytes) -> None:
        if data == b"b":
            os.kill(os.getpid(), signal.SIGKILL)

    row = run_door(Door("a door", (b"a", b"b", b"c"), change_text, read), SEED, range(3), math.inf)
    assert (row.inputs, row.accepted) == (3, 2)
    assert row.faults == {"the process ended with status 9": [1]}


def test_a_part_repeated_makes_large_inputs_of_lines_columns_and_numbered_keys(monkeypatch):
    monkeypatch.setattr(mutations, "LARGEST", 20_000)
    chance = random.Random(SEED)  # noqa: S311 - repeatable, no secret
    table = b"a\tb\tc\n" + b"1\t2\t3\n" * 4
    made = [repeat_part(chance, table) for _ in range(60)]
    assert max(map(len, made)) <= 20_000
    assert sum(len(data) > 10_000 for data in made) > 40
    assert any(data.count(b"\n") > 1000 for data in made), "a line"
    assert any(data.count(b"\n") == 5 and data.splitlines()[-1].count(b"\t") > 1000 for data in made), "a column"
    assert any(re.search(rb"a0.*a1.*a2", data[:99], re.DOTALL) for data in made), "a key"
    keys = [repeat_part(chance, b"a = 1\n") for _ in range(200)]
    assert any(data.startswith(b"a.a.a.a.") for data in keys), "a dotted key"


def test_what_takes_too_much_of_a_repeated_part_is_found():
    taken = []

    def read(data: bytes) -> None:
        taken.append([{line: 1} for line in data.splitlines()])

    door = Door("a door", (b"1\n2\n",), repeat_part, read)
    row = run_door(door, SEED, range(12), math.inf)
    assert list(row.faults) == ["more memory than 4 times the input and 64 MB"]


def test_a_seed_repeats_its_inputs(doors):
    door = doors["BVH"]
    first, again = ([changed_input(door, SEED, number) for number in range(30)] for _ in range(2))
    assert first == again
    assert first != [changed_input(door, SEED + 1, number) for number in range(30)]
