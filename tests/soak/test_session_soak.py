"""Soak of a session: as many frames as asked for, and what counts as growth."""

import sys
from math import inf

import pytest

if sys.platform != "linux":
    pytest.skip("looks at /proc", allow_module_level=True)

from soak.sessions import FPS, MOST_GROWN_MB, MOST_SLOWER, TENTHS, soak, wrong_of


def test_all_frames_are_solved_without_an_end_of_time() -> None:
    rows = list(soak(inf, 20, "nearest", 1))
    assert [row["frames"] for row in rows] == [2] * TENTHS
    assert rows[-1]["hours"] == pytest.approx(19 / FPS / 3600)  # time of the last frame


def test_growth_from_the_first_tenth_to_the_last_is_told() -> None:
    first = {"memory_mb": 100.0, "p99_processor_ms": 4.0}
    assert wrong_of([first, first]) == []
    assert wrong_of([first, {**first, "memory_mb": 101.0 + MOST_GROWN_MB}]) == ["memory grew by 11.0 MB"]
    slower = {**first, "p99_processor_ms": 4.0 * (MOST_SLOWER + 0.05)}
    assert wrong_of([first, slower]) == ["the last tenth took 1.10 times as long"]
    assert wrong_of([slower, first]) == []
