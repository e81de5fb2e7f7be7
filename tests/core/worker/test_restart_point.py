"""Numbers and times where a capture goes on after a process was replaced."""

import numpy as np
import pytest
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.worker.restart_point import FrameOffset, RestartPoint, gap_text


def test_a_camera_that_began_anew_goes_on_by_the_clock() -> None:
    seam = RestartPoint.after((0, 0.5), (59, 0.5 + 59 / 60), 100.0)
    assert seam.period_s == pytest.approx(1 / 60)
    first = MarkerFrame(0, 0.02, blobs=(np.empty((0, 5), np.float32),) * 2, camera_times_s=np.array([0.02, np.nan]))
    shift = seam.offset(102.0, first)
    frame = shift.apply(first)
    assert frame.number == 59 + 120
    assert frame.time_s == pytest.approx(0.5 + 59 / 60 + 2.0)
    np.testing.assert_allclose(frame.camera_times_s, [frame.time_s, np.nan])
    assert seam.gap_s(frame) == pytest.approx(2.0 - 1 / 60)
    later = shift.apply(MarkerFrame(3, 0.07))
    assert (later.number, later.time_s) == (frame.number + 3, pytest.approx(frame.time_s + 0.05))


def test_a_frame_after_a_seam_always_comes_after_it() -> None:
    seam = RestartPoint.after((7, 1.0), (7, 1.0), 100.0)  # one frame tells no rate
    frame = seam.offset(99.0, MarkerFrame(0, 0.0)).apply(MarkerFrame(0, 0.0))
    assert frame.number == 8
    assert frame.time_s > 1.0
    assert seam.gap_s(frame) == 0.0


def test_a_seam_keeps_its_rate_behind_another_frame() -> None:
    seam = RestartPoint(9, 1.1, 100.1, 0.02)
    assert seam.moved_to(100.0, MarkerFrame(5, 1.0)) == RestartPoint(5, 1.0, 100.0, 0.02)


def test_what_is_missing_is_told_in_plain_words() -> None:
    assert gap_text(1.34) == "1.3 s are missing"
    assert gap_text(0.0) == "nothing is missing"
    same = MarkerFrame(3, 0.1)
    assert FrameOffset().apply(same) is same
