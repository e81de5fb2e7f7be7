import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.vision.calibration.calibration_board import Board, BoardView
from perfanim.core.vision.calibration.rig_on_floor import board_in_space, rig_on_floor

NOISE_M = 0.001


def board_on_the_floor(turn):
    """Corners of a 0.6 m x 0.4 m board on the floor of a room whose axes are known: y up, the cameras at +z."""
    grid = np.stack(np.meshgrid(np.linspace(-0.3, 0.3, 7), [0.0], np.linspace(-0.2, 0.2, 5)), axis=-1).reshape(-1, 3)
    return rot.rotate(rot.from_rotation_vector([0.0, turn, 0.0]), grid)


@pytest.fixture
def room():
    """Two cameras 1.4 m above the floor, 3 m before the board, and the same seen from another world."""
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    cameras = []
    for name, x in (("left", -0.5), ("right", 0.5)):
        centre = np.array([x, 1.4, 3.0])
        down = rot.to_matrix(rot.from_rotation_vector([0.3, 0.0, 0.0]))
        rotation = down @ np.diag([1.0, -1.0, -1.0])
        cameras.append(Camera(name, (640, 480), matrix, rotation=rotation, translation_m=-rotation @ centre))
    return tuple(cameras)


def seen_from(cameras, turn, shift):
    """The cameras in the world p_new = turn p + shift."""
    return tuple(
        Camera(c.name, c.image_size, c.matrix, c.distortion, c.rotation @ turn.T,
               c.translation_m - c.rotation @ turn.T @ shift) for c in cameras
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("behind", [0.0, 0.7])
def test_floor_is_found_from_any_world(room, seed, behind):
    rng = np.random.default_rng(seed)
    turn = rot.to_matrix(rot.from_rotation_vector(rng.normal(size=3)))
    shift = rng.normal(size=3)
    board = board_on_the_floor(rng.uniform(-3.0, 3.0))
    points = board @ turn.T + shift + rng.normal(scale=NOISE_M, size=board.shape)
    rig = rig_on_floor(CameraRig(seen_from(room, turn, shift), {"error": 0.2}), points, behind)
    assert rig.metadata == {"error": 0.2, "floor": "y = 0"}
    # 1 mm over corners that scatter by 0.12 m or more: the plane tilts by 1 mm / (0.12 m sqrt(35)), 4 m away 6 mm
    for found, true in zip(rig.cameras, room, strict=True):
        np.testing.assert_allclose(found.centre_m, true.centre_m + np.array([0.0, 0.0, behind]), atol=5 * 0.006)
        np.testing.assert_allclose(found.rotation, true.rotation, atol=5 * 0.0015)
    # what the cameras see of the board stays the same
    middle = np.array([[0.0, 0.0, behind]])
    np.testing.assert_allclose(rig.cameras[0].project(middle), room[0].project(np.zeros((1, 3))), atol=1.0)


def test_three_points_determine_the_floor(room):
    rig = rig_on_floor(CameraRig(room), [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.1], [0.0, 0.0, -0.1]])
    np.testing.assert_allclose(rig.cameras[1].centre_m, room[1].centre_m, atol=1e-9)


def test_points_that_are_not_a_floor_are_refused(room):
    rig = CameraRig(room)
    with pytest.raises(CalibrationError, match="three points are needed"):
        rig_on_floor(rig, np.zeros((2, 3)))
    rough = board_on_the_floor(0.0) + np.random.default_rng(0).normal(scale=0.05, size=(35, 3))
    with pytest.raises(CalibrationError, match="do not determine a plane; lay the board or the markers flat"):
        rig_on_floor(rig, rough)
    line = np.linspace(0.0, 1.0, 10)[:, None] * np.array([1.0, 0.0, 0.5])
    with pytest.raises(CalibrationError, match="do not determine a plane"):
        rig_on_floor(rig, line)
    with pytest.raises(CalibrationError, match="straight down"):
        rig_on_floor(rig, board_on_the_floor(0.0) + np.array([0.0, 0.0, 3.0]))


@pytest.mark.parametrize("cameras", [1, 2])
def test_board_is_found_in_space_by_one_and_two_cameras(room, cameras):
    board = Board("chessboard", 9, 6, 0.06)
    flat = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    true = (board.points_m - board.points_m.mean(axis=0)) @ flat.T
    rig = CameraRig(room[:cameras])
    views = [BoardView(np.arange(54), camera.project(true)) for camera in rig.cameras]
    views[-1] = views[-1].reverse() if cameras == 2 else views[-1]  # two may number a chessboard differently
    np.testing.assert_allclose(board_in_space(rig, views, board), true, atol=1e-4)
    with pytest.raises(CalibrationError, match=f"for {cameras} cameras?, but the images are from {cameras + 1}"):
        board_in_space(rig, [*views, views[0]], board)
    with pytest.raises(CalibrationError, match="not all cameras see the whole board"):
        board_in_space(rig, [*views[:-1], BoardView(np.arange(53), views[-1].pixels[:53])], board)


def test_moved_cameras_are_refused(room):
    board = Board("chessboard", 9, 6, 0.06)
    views = [BoardView(np.arange(54), camera.project(board.points_m)) for camera in room]
    views[1] = BoardView(views[1].ids, views[1].pixels + np.array([0.0, 20.0]))
    with pytest.raises(CalibrationError, match="do not agree on where the board is"):
        board_in_space(CameraRig(room), views, board)
