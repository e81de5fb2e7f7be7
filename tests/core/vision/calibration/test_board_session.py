"""A board carried before two cameras: what is taken, what is said, and when it ends.

The corners are where the true cameras see them, with noise; finding them in images is tested elsewhere.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pytest
from futures import at_once
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, BoardPose, board_poses
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.calibration import board_session
from perfanim.core.vision.calibration.board_session import BoardSession, Guidance
from perfanim.core.vision.calibration.board_watch import GUIDANCE
from perfanim.core.vision.calibration.calibration_board import BoardView

PLACES = 30
PERIOD_S = 0.125
HELD_FRAMES = 6
CORNER_SIGMA_PX = 0.1

BLIND = np.zeros((480, 640, 3), np.uint8)


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return default_rig()


@pytest.fixture(scope="module")
def poses(rig: CameraRig) -> tuple[BoardPose, ...]:
    return board_poses(rig, DEFAULT_BOARD, PLACES)


class Scene:
    """Images whose corners are known: each carries its number in its first pixel."""

    def __init__(self, rig: CameraRig) -> None:
        self.rig = rig
        self.views: list[BoardView] = []
        self._rng = np.random.default_rng(0)

    def find(self, image: np.ndarray, _board: object) -> BoardView | None:
        number = int(image[0, 0].astype(int) @ [1, 256, 0])
        return self.views[number - 1] if number else None

    def taken(self, pose: BoardPose) -> list[np.ndarray]:
        images = []
        for camera in self.rig.cameras:
            pixels = camera.project(pose.points(DEFAULT_BOARD.points_m))
            noisy = pixels + self._rng.normal(scale=CORNER_SIGMA_PX, size=pixels.shape)
            self.views.append(BoardView(np.arange(len(noisy)), noisy))
            images.append(BLIND.copy())
            images[-1][0, 0] = (len(self.views) % 256, len(self.views) // 256, 0)
        return images

    def carried(self, poses: Sequence[BoardPose]) -> Iterator[list[np.ndarray]]:
        """Yield the images of a board that is held in each place, and of the way to the next."""
        for here, there in pairwise((*poses, poses[-1])):
            for _ in range(HELD_FRAMES):
                yield self.taken(here)
            for f in (0.25, 0.5, 0.75) if there is not here else ():
                between = here.position_m + f * (there.position_m - here.position_m)
                yield self.taken(BoardPose(here.world_from_board, between))


@pytest.fixture
def scene(rig: CameraRig, monkeypatch: pytest.MonkeyPatch) -> Scene:
    made = Scene(rig)
    monkeypatch.setattr(board_session, "glimpse_board", made.find)
    monkeypatch.setattr(board_session, "find_board", made.find)
    return made


def new_session(limit: int = 40, every_s: float | None = None) -> BoardSession:
    titles = ("the left camera", "the right camera")
    return BoardSession(DEFAULT_BOARD, ("left", "right"), titles, at_once, limit, every_s)


def play(
    session: BoardSession, scene: Scene, poses: Sequence[BoardPose], order: Sequence[int] = (0, 1)
) -> list[Guidance]:
    """Carry the board through places until the session is done; return what it made of it."""
    sights = []
    for number, images in enumerate(scene.carried(poses)):
        sights.append(session.see(number * PERIOD_S, [images[camera] for camera in order], (True,) * len(order)))
        if session.done:
            break
    return sights


def test_session_ends_with_a_good_calibration(scene: Scene, poses: tuple[BoardPose, ...], rig: CameraRig) -> None:
    session = new_session()
    sights = play(session, scene, poses)
    assert session.good
    assert GUIDANCE.enough_views <= session.views < PLACES
    result = session.finish()
    assert result.verdict == "good"
    assert result.baseline_m == pytest.approx(rig.baseline_m(), rel=4 * result.distance_sigma)
    assert result.rms_px["left"] == pytest.approx(np.sqrt(2.0) * CORNER_SIGMA_PX, rel=0.1)  # less what fits the noise
    taken = [guidance for guidance in sights if guidance.taken]
    assert len(taken) == session.views
    assert all(guidance.seen is not None and guidance.seen.still for guidance in taken)
    # a part of an image is asked for as long as too little is covered, and none that is covered already
    assert all(guidance.target is not None for guidance in taken[:4])
    assert taken[-1].target is None
    assert session.fraction == 1.0


def test_session_gives_advice(scene: Scene, poses: tuple[BoardPose, ...]) -> None:
    session = new_session()
    sights = play(session, scene, poses[:1])
    assert sights[0].advice == "hold it still"
    assert sights[-1].advice.startswith("move it to the ")  # in the same place it is not taken twice
    assert session.views == 1
    camera, (row, column) = sights[-1].target or (0, (1, 1))
    covered = session.coverage[camera].reshape(3, 6, 3, 8).mean(axis=(1, 3))
    assert covered[row, column] == 0.0
    assert session.see(100.0, [BLIND, BLIND], (True, True)).advice == "show the whole board to all cameras"
    held = scene.taken(poses[0])
    one = session.see(101.0, held, (True, False))
    assert one.advice == "hold it so that the right camera sees all of it too"
    assert not one.taken


def test_advice_names_a_board_of_another_size(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_session, "seen_grid", lambda _image, _grid: (8, 5))
    session = new_session()
    said = [session.see(number * PERIOD_S, [BLIND, BLIND], (True, True)).advice for number in range(80)]
    assert said[0] == "show the whole board to all cameras"
    assert said[-1].startswith("this board has 8x5 inner corners, not 9x6")


def test_session_ends_at_the_limit_with_advice(scene: Scene, poses: tuple[BoardPose, ...]) -> None:
    session = new_session(limit=4)
    play(session, scene, poses)
    assert session.done and not session.good
    result = session.finish()
    assert result.verdict == "usable"
    assert any("4 moments" in advice for advice in result.advice)


def test_finish_needs_three_views(scene: Scene, poses: tuple[BoardPose, ...]) -> None:
    session = new_session()
    play(session, scene, poses[:2])
    with pytest.raises(CalibrationError, match="in 2 places, but 3 are needed"):
        session.finish()


def test_timed_views_are_taken_while_the_board_moves(scene: Scene, poses: tuple[BoardPose, ...]) -> None:
    session = new_session(every_s=0.4)
    sights = play(session, scene, poses[:2])
    taken = [guidance for guidance in sights if guidance.taken]
    assert any(guidance.seen is not None and not guidance.seen.still for guidance in taken)
    assert any(guidance.advice.startswith("1: ") for guidance in sights)
    assert len(taken) >= 3  # in 1.9 s


def test_exchanged_cameras_are_refused_during_the_session(scene: Scene, poses: tuple[BoardPose, ...]) -> None:
    session = new_session()
    with pytest.raises(CalibrationError, match=r"camera left stands on the right, .*; exchange"):
        play(session, scene, poses, order=(1, 0))
    assert session.views < GUIDANCE.enough_views


def test_single_camera_gets_its_lens(scene: Scene, poses: tuple[BoardPose, ...], rig: CameraRig) -> None:
    session = BoardSession(DEFAULT_BOARD, ("camera1",), ("the camera",), at_once, 40)
    play(session, scene, poses, order=(1,))
    assert session.good
    (found,) = session.finish().rig.cameras
    true = rig.cameras[1]
    # within a pixel out to the image's corners, where the board has not been
    points = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 9)), axis=-1)
    off = found.to_pixels(points) - true.to_pixels(points)
    assert np.abs(off - off.mean(axis=(0, 1))).max() < 1.0
