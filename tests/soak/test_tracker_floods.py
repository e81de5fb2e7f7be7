"""A flood of a second at the port of a capture: nothing piles up, and what is left out is told."""

import sys

import pytest

if sys.platform != "linux":
    pytest.skip("looks at /proc", allow_module_level=True)

from soak.trackers import MOST_BLENDER_MB, MOST_WAITING, MOST_WORKERS_MB, flooded


@pytest.mark.long
def test_a_flood_of_frames_does_not_pile_up() -> None:
    row = flooded("frames", 1.5, 40_000, seed=1, around_s=1.5)
    assert row["error"] == ""
    assert row["sent"] > 20_000
    assert row["waiting"] <= MOST_WAITING
    assert row["grown_mb"] <= MOST_WORKERS_MB
    assert row["blender_mb"] <= MOST_BLENDER_MB
    assert row["left_out"] > 0.9 * row["sent"]  # each packet is a frame, and a second has room for few
