"""The check before a capture names the fault of a simulated studio, and none in a healthy one."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate import practice_studio
from perfanim.core.simulate.practice_studio import STUDIO_FAULTS, board_views, studio_with
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.subjects.setup_check.board_faults import board_faults, square_px
from perfanim.core.subjects.setup_check.find_faults import check_pictures, check_setup
from perfanim.core.subjects.setup_check.finding import Fault
from perfanim.core.subjects.setup_check.rig_faults import place_fault
from perfanim.core.vision.calibration.calibration_board import Board, BoardView
from perfanim.core.vision.detection.background import learn_backgrounds

FREQUENT = (Fault.DARK, Fault.EXCHANGED, Fault.BUMPED, Fault.SQUARE_SIZE, Fault.MARKER_MISSING)  # the others: long


@pytest.fixture
def few_frames(monkeypatch):
    """Studios filmed at 15 frames per second: the same faults in half the pictures."""
    monkeypatch.setattr(practice_studio, "FPS", 15.0)


def findings_of(studio):
    backgrounds = learn_backgrounds(studio.empty)
    return check_setup(studio.rig, backgrounds, studio.moments, studio.marker_set, studio.height_m)


def test_every_fault_has_a_studio_or_a_board():
    assert {*STUDIO_FAULTS, Fault.BOARD_SMALL} == set(Fault)
    assert len(Fault) == 13


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_healthy_studios_have_no_fault(seed):
    assert findings_of(studio_with(None, np.random.default_rng([5, seed]))) == []


@pytest.mark.parametrize(
    "fault", [pytest.param(each, marks=[] if each in FREQUENT else pytest.mark.long) for each in STUDIO_FAULTS]
)
def test_the_fault_is_named_and_no_other(few_frames, fault):
    findings = findings_of(studio_with(fault, np.random.default_rng([6, STUDIO_FAULTS.index(fault)])))
    assert {finding.fault for finding in findings} == {fault}
    for finding in findings:
        assert ";" in finding.text or ":" in finding.text  # a fact, then advice


@pytest.mark.long
def test_reflections_are_ignored_before_and_after_the_calibration(few_frames):
    studio = studio_with(Fault.REFLECTION, np.random.default_rng(18))
    names = [camera.name for camera in studio.rig.cameras]
    backgrounds = learn_backgrounds(studio.empty)
    found = check_pictures(names, backgrounds, studio.moments)
    assert {finding.fault for finding in found} == {Fault.REFLECTION}
    places = [place for finding in found for place in finding.places]
    assert places
    assert check_pictures(names, backgrounds, studio.moments, places) == []
    assert findings_of(replace(studio, rig=studio.rig.ignoring(places))) == []
    assert findings_of(replace(studio, rig=studio.rig.ignoring(places[1:]))) != []  # the others are seen as before


@pytest.mark.parametrize("small", [True, pytest.param(False, marks=pytest.mark.long)])
def test_board(small):
    found = board_faults(*board_views(np.random.default_rng(3), small))
    assert {finding.fault for finding in found} == ({Fault.BOARD_SMALL} if small else set())


def test_square_px_of_an_exact_view():
    board = Board("chessboard", 9, 6, 0.03)
    pixels = board.points_m[:, :2] / 0.03 * 17.0 + 100.0
    view = BoardView(np.arange(len(pixels)), pixels)
    assert square_px(board, view) == pytest.approx(17.0)
    part = BoardView(view.ids[7:12], view.pixels[7:12])  # the end of a row and the beginning of the next
    assert square_px(board, part) == pytest.approx(17.0)


@pytest.mark.parametrize(("z_m", "fault"), [(1.5, Fault.CLOSE), (0.0, None), (-4.0, Fault.FAR)])
def test_place(z_m, fault):
    found = place_fault(default_rig(), np.array([0.0, 1.0, z_m]), 1.75)
    assert [finding.fault for finding in found] == ([fault] if fault else [])


@pytest.mark.long
def test_too_few_moments_are_refused(monkeypatch):
    monkeypatch.setattr(practice_studio, "SECONDS", 3 / practice_studio.FPS)
    studio = studio_with(None, np.random.default_rng(0))
    with pytest.raises(CaptureError, match="3 moments are too few"):
        check_setup(studio.rig, learn_backgrounds(studio.empty), studio.moments, load_marker_set("boxing"))
