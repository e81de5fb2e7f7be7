"""A few random sequences with a fixed seed, while a capture is live; `make operator-fuzz WINDOW=yes` runs hundreds."""

import math
import shutil
from pathlib import Path

import pytest
from desktop import Desktop
from operator_fuzz.window import run_in

SEED, SEQUENCES = 1, 3


@pytest.mark.walkthrough
def test_random_steps_of_a_live_capture_leave_nothing(desktop: Desktop, user: Path, tmp_path: Path) -> None:
    shutil.copytree(user, tmp_path / "user", symlinks=True)
    results = list(run_in(desktop, tmp_path, SEED, range(SEQUENCES), math.inf))
    assert [result["number"] for result in results] == list(range(SEQUENCES))
    assert [result for result in results if result["faults"]] == []
    assert sum(result["steps"] for result in results) > 3 * SEQUENCES
