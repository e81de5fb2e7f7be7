"""A short run of the random steps with a fixed seed; `make operator-fuzz` runs ten thousand sequences."""

import math
import sys
from pathlib import Path

import bpy
import pytest
from remains import remains

if sys.platform != "linux":
    pytest.skip("processes are looked for in /proc", allow_module_level=True)

from operator_fuzz import sequence
from operator_fuzz.__main__ import run_headless
from operator_fuzz.errors import errors_in

SEED, SEQUENCES = 1, 10


def test_random_steps_end_without_an_error_and_leave_nothing() -> None:
    results = list(run_headless(SEED, 0, SEQUENCES, math.inf))
    assert [result["number"] for result in results] == list(range(SEQUENCES))
    assert [result for result in results if result["faults"]] == []
    assert sum(result["steps"] for result in results) > 3 * SEQUENCES


@pytest.mark.long
def test_what_is_left_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence, "_ENDING_S", 0.0)  # processes of other tests stay
    before = remains()
    assert sequence.left_over(before, tmp_path) == []
    (tmp_path / "tmp").mkdir()
    (tmp_path / "tmp" / "forgotten").touch()
    image = bpy.data.images.new("Perfanim Preview", 4, 4)
    try:
        found = sequence.left_over(before, tmp_path)
    finally:
        bpy.data.images.remove(image)
    assert [line.partition(":")[0] for line in found] == ["images", "file"]


def test_a_process_that_ends_is_a_fault_of_its_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    results = list(run_headless(SEED, 3, 5, math.inf))
    assert [result["number"] for result in results] == [3, 4]
    assert all(result["faults"] == ["the process ended with 1: "] for result in results)


def test_errors_are_found_in_what_is_printed() -> None:
    assert errors_in("Info: saved\nError: refused\n") == []
    assert "KeyError" in errors_in("Info\nTraceback (most recent call last):\nKeyError: 'a'\n")[0]


def test_a_seed_repeats_its_steps() -> None:
    (_, first), (_, again), (_, other) = (sequence.steps_of(seed, 7) for seed in (1, 1, 2))
    assert first == again != other
