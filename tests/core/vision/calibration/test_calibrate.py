import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.vision.calibration.board_points import load_board_points
from perfanim.core.vision.calibration.calibrate import calibrate_from_points
from perfanim.core.vision.calibration.calibration_board import Board, BoardView
from perfanim.core.vision.calibration.rig_fit import CameraViews

BOARD = Board("chessboard", 8, 6, 0.06)  # looks the same after half a turn
NOISE_PX = 0.1


def board_poses(rig: CameraRig, count: int, seed: int = 0) -> list[np.ndarray]:
    """World points of the board held about 1.6 m in front of the rig, all points in both pictures."""
    rng = np.random.default_rng(seed)
    kept = []
    while len(kept) < count:
        turn = rot.to_matrix(rot.from_rotation_vector(rng.uniform([-0.6, -0.6, -0.3], [0.6, 0.6, 0.3])))
        place = np.array([rng.uniform(-0.45, 0.45), rng.uniform(-0.4, 0.4), rng.uniform(-2.2, -1.4)])
        local = (BOARD.points_m - BOARD.points_m.mean(axis=0)) * [1.0, -1.0, -1.0]
        world = local @ turn.T + place
        pixels = [camera.project(world) for camera in rig.cameras]
        if all(((p > 5) & (p < np.array([635, 475]))).all() for p in pixels):
            kept.append(world)
    return kept


def views(rig: CameraRig, count: int, seed: int = 0, noise: float = NOISE_PX) -> list[CameraViews]:
    rng = np.random.default_rng(seed + 1)
    worlds = board_poses(rig, count, seed)
    ids = np.arange(len(BOARD.points_m))
    return [
        CameraViews(
            camera.name,
            camera.image_size,
            {
                f"{k:03d}": BoardView(ids, camera.project(w) + rng.normal(0, noise, (len(ids), 2)))
                for k, w in enumerate(worlds)
            },
        )
        for camera in rig.cameras
    ]


def reversed_view(view: BoardView) -> BoardView:
    return BoardView(view.ids, view.pixels[::-1].copy())


def with_views(camera: CameraViews, changes: dict[str, BoardView]) -> CameraViews:
    return CameraViews(camera.name, camera.image_size, dict(camera.views) | changes)


def test_true_cameras_are_found(rig):
    result = calibrate_from_points(BOARD.points_m, views(rig, 20), ambiguous=True)
    assert result.verdict == "good" and result.rejected == ()
    assert len(result.used) == 20
    assert NOISE_PX < result.stereo_rms_px < NOISE_PX * np.sqrt(2) * 1.05
    assert result.held_out_px < 1.3 * result.stereo_rms_px
    assert result.baseline_m == pytest.approx(rig.baseline_m(), rel=2e-3)
    left = result.rig.cameras[0]
    np.testing.assert_allclose(left.rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    np.testing.assert_allclose(left.centre_m, 0.0, atol=1e-12)
    for found, true in zip(result.rig.cameras, rig.cameras, strict=True):
        np.testing.assert_allclose(np.diag(found.matrix), np.diag(true.matrix), rtol=5e-3)
    relative = result.rig.cameras[1].rotation @ left.rotation.T
    truth = rig.cameras[1].rotation @ rig.cameras[0].rotation.T
    assert np.degrees(np.arccos((np.trace(relative @ truth.T) - 1) / 2)) < 0.2


def test_half_turns_of_the_board_are_resolved(rig):
    left, right = views(rig, 16)
    turned = with_views(right, {key: reversed_view(right.views[key]) for key in list(right.views)[::3]})
    result = calibrate_from_points(BOARD.points_m, [left, turned], ambiguous=True)
    assert len(result.used) == 16
    assert result.stereo_rms_px < NOISE_PX * np.sqrt(2) * 1.05


def test_mismatched_pairs_are_rejected_with_a_reason(rig):
    left, right = views(rig, 16)
    mixed = with_views(right, {"003": right.views["009"], "012": right.views["001"]})
    result = calibrate_from_points(BOARD.points_m, [left, mixed], ambiguous=True)
    assert {row.picture for row in result.rejected} == {"003", "012"}
    assert all(row.reason for row in result.rejected)
    assert result.baseline_m == pytest.approx(rig.baseline_m(), rel=3e-3)


def test_noisy_view_is_rejected(rig):
    left, right = views(rig, 16)
    bent = left.views["005"].pixels + np.random.default_rng(0).normal(0, 4, (48, 2))
    result = calibrate_from_points(
        BOARD.points_m,
        [with_views(left, {"005": BoardView(left.views["005"].ids, bent)}), right],
        ambiguous=True,
    )
    assert [row.picture for row in result.rejected] == ["left 005"]


def test_exchanged_cameras_are_refused(rig):
    left, right = views(rig, 10)
    swapped = [CameraViews("left", right.image_size, right.views), CameraViews("right", left.image_size, left.views)]
    with pytest.raises(CalibrationError, match="camera left stands on the right"):
        calibrate_from_points(BOARD.points_m, swapped, ambiguous=True)
    assert calibrate_from_points(BOARD.points_m, swapped, left_right=False, ambiguous=True).used


def test_pictures_of_one_camera_twice_are_refused(rig):
    left, right = views(rig, 12)
    generator = np.random.default_rng(3)
    copies = {  # as compression changes them
        key: BoardView(view.ids, view.pixels + generator.normal(0.0, 0.1, view.pixels.shape))
        for key, view in left.views.items()
    }
    copy = CameraViews(right.name, right.image_size, copies)
    with pytest.raises(
        CalibrationError, match=f"cameras {left.name} and {right.name} have the same pictures; give each"
    ):
        calibrate_from_points(BOARD.points_m, [left, copy], ambiguous=True)


def test_shifted_lists_are_refused(rig):
    left, right = views(rig, 12)
    keys = sorted(right.views)
    shifted = {key: right.views[other] for key, other in zip(keys, keys[3:] + keys[:3], strict=True)}
    with pytest.raises(CalibrationError, match="do not match"):
        calibrate_from_points(BOARD.points_m, [left, CameraViews("right", right.image_size, shifted)])


def test_too_few_views_are_refused(rig):
    left, right = views(rig, 6)
    few = CameraViews("left", left.image_size, dict(list(left.views.items())[:2]))
    with pytest.raises(CalibrationError, match=r"camera left.*2 picture"):
        calibrate_from_points(BOARD.points_m, [few, right])
    apart = CameraViews("right", right.image_size, {f"x{key}": view for key, view in right.views.items()})
    with pytest.raises(CalibrationError, match="right never saw the board together with left"):
        calibrate_from_points(BOARD.points_m, [left, apart])


def test_few_moments_are_usable_with_advice(rig):
    result = calibrate_from_points(BOARD.points_m, views(rig, 5), ambiguous=True)
    assert result.verdict == "usable"
    assert any("12" in line for line in result.advice)
    assert np.isnan(result.held_out_px)


def test_third_camera_that_shares_views_with_one_other_joins_the_rig(rig):
    wide = three_cameras(rig)
    third = wide.cameras[2]
    rows = views(wide, 18)
    only_with_right = CameraViews("third", third.image_size, {k: v for k, v in rows[2].views.items() if int(k) >= 6})
    first = CameraViews("left", wide.cameras[0].image_size, {k: v for k, v in rows[0].views.items() if int(k) < 12})
    result = calibrate_from_points(BOARD.points_m, [first, rows[1], only_with_right], ambiguous=True)
    assert len(result.rig) == 3
    assert result.rig.baseline_m(0, 2) == pytest.approx(wide.baseline_m(0, 2), rel=5e-3)


def three_cameras(rig: CameraRig) -> CameraRig:
    left, right = rig.cameras
    shifted = left.translation_m + np.array([-0.3, 0.0, 0.0])
    return CameraRig((left, right, replace(left, name="third", translation_m=shifted)))


def test_rejected_view_of_one_of_three_cameras_keeps_the_moment(rig):
    rows = views(three_cameras(rig), 14)
    shifted = BoardView(rows[2].views["004"].ids, rows[2].views["004"].pixels + 6.0)
    result = calibrate_from_points(
        BOARD.points_m, [rows[0], rows[1], with_views(rows[2], {"004": shifted})], ambiguous=True
    )
    assert [row.picture for row in result.rejected] == ["third 004"]
    assert ("004", "left") in result.views_px and ("004", "third") not in result.views_px
    assert result.rig.baseline_m(0, 2) == pytest.approx(0.3, rel=5e-3)


def moving(camera: CameraViews, late_s: float, seed: int) -> CameraViews:
    """Views of a board that moves by about 100 pixels a second, taken later than said."""
    rng = np.random.default_rng(seed)
    rows = {}
    for key, view in camera.views.items():
        motion = np.tile(rng.uniform(-150.0, 150.0, 2), (len(view.ids), 1))
        rows[key] = BoardView(view.ids, view.pixels + late_s * motion, motion)
    return CameraViews(camera.name, camera.image_size, rows)


@pytest.mark.long
def test_delayed_camera_is_reported_and_costs_little(rig):
    left, right = views(rig, 20)
    pair = [moving(left, 0.0, 1), moving(right, 0.06, 2)]
    some = [f"{k:03d}" for k in range(9)]  # for the contrast, as few as are fitted without a choice of the lens model
    blind = [
        CameraViews(c.name, c.image_size, {k: BoardView(c.views[k].ids, c.views[k].pixels) for k in some}) for c in pair
    ]
    result = calibrate_from_points(BOARD.points_m, pair, ambiguous=True)
    assert result.late_s["left"] == 0.0
    assert result.late_s["right"] == pytest.approx(0.06, abs=0.01)  # half of what is worth telling
    assert any("right +" in line and "at the same time" in line for line in result.advice)
    assert result.stereo_rms_px < 2.0 * NOISE_PX * np.sqrt(2)
    assert result.baseline_m == pytest.approx(rig.baseline_m(), rel=5e-3)
    assert calibrate_from_points(BOARD.points_m, blind, ambiguous=True).stereo_rms_px > 1.0


@pytest.mark.long
def test_distance_sigma_equals_the_scatter_of_repeated_calibrations(rig):
    errors, sigmas = [], []
    for seed in range(8):
        result = calibrate_from_points(BOARD.points_m, views(rig, 9, seed, 0.3), ambiguous=True)
        errors.append(result.baseline_m / rig.baseline_m() - 1.0)
        sigmas.append(result.distance_sigma)
    # chi-square of 8: 99.9 % of such sums lie between 0.86 and 26
    assert 0.86 < np.sum((np.array(errors) / np.array(sigmas)) ** 2) < 26.0


def test_advice_names_smeared_and_blurred_pictures(rig):
    widths_px = {"left": (2.0, 9.0), "right": (8.0, 9.0)}
    rows = [
        with_views(c, {key: replace(view, edge_widths_px=widths_px[c.name]) for key, view in c.views.items()})
        for c in views(rig, 10)
    ]
    result = calibrate_from_points(BOARD.points_m, rows, ambiguous=True)
    told = " | ".join(result.advice)
    assert "left: exposure too long: corners smeared over 9 pixels" in told
    assert "right is out of focus: edges 9 pixels wide" in told
    assert result.verdict == "usable"


def test_board_points_are_read_from_json(rig, tmp_path):
    left, right = views(rig, 10)
    content = {
        "image_size": [640, 480],
        "board_points_mm": (BOARD.points_m[:, :2] * 1000).tolist(),
        "image_points_cam1": [left.views[key].pixels.tolist() for key in sorted(left.views)],
        "image_points_cam2": [right.views[key].pixels.tolist() for key in sorted(right.views)],
    }
    content["image_points_cam2"][2][7] = None  # a point that the second camera does not see
    path = tmp_path / "points.json"
    path.write_text(json.dumps(content))
    points, cameras = load_board_points(path)
    np.testing.assert_allclose(points, BOARD.points_m)
    assert len(cameras[1].views["000003"].ids) == len(points) - 1
    result = calibrate_from_points(points, cameras)
    assert result.baseline_m == pytest.approx(rig.baseline_m(), rel=5e-3)


def test_single_camera_gets_its_lens(rig):
    result = calibrate_from_points(BOARD.points_m, views(rig, 20)[:1])
    assert result.verdict == "good" and len(result.used) == 20 and result.baseline_m == 0.0
    (found,) = result.rig.cameras
    np.testing.assert_allclose(found.centre_m, 0.0, atol=1e-12)
    assert found.focal_px == pytest.approx(rig.cameras[0].focal_px, rel=0.005)
    assert result.stereo_rms_px < NOISE_PX * np.sqrt(2) * 1.05
    few = calibrate_from_points(BOARD.points_m, views(rig, 4)[:1])
    assert any("the board was seen in only 4 moments" in line for line in few.advice)
