"""Preview pictures: is the figure where the skeleton is, are its sides told apart, do the files open again?"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CaptureError
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate import preview
from perfanim.core.simulate.studio.cones import first_hits
from perfanim.core.simulate.studio.performer_body import make_body
from perfanim.core.simulate.studio.video import write_video

SKELETON = default_skeleton()
ROOT = np.array([0.1, 0.98, 0.0])


def camera() -> preview.Camera:
    return preview.preview_camera(ROOT)


def draw_character(image, view, skeleton, rotations, root, style=preview.SOLVED) -> None:
    preview.CharacterPainter(view, skeleton, style).draw(image, rotations, root)


def test_camera_frames_a_whole_motion() -> None:
    path = np.array([[-0.8, 0.9, -0.7], [0.7, 1.4, 0.9], [0.0, 0.98, 0.0]])
    view = preview.preview_camera(path)
    for root in path:
        positions, world = forward_kinematics(SKELETON, t_pose(SKELETON), root)
        tips = positions + rot.rotate(world, SKELETON.tips_m)
        pixels = view.project(np.concatenate((positions, tips)))
        assert np.all((pixels > 0.0) & (pixels < view.image_size))


def test_figure_covers_what_the_body_covers() -> None:
    view = camera()
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    style = replace(preview.SOLVED, shadow=False)
    draw_character(image, view, SKELETON, t_pose(SKELETON), ROOT, style)
    drawn = image.max(axis=2) > 57  # of 115 at the rim: at least half of the pixel
    cones = make_body(SKELETON).cones(t_pose(SKELETON), ROOT)
    grid = np.stack(np.meshgrid(np.arange(0, 640, 3), np.arange(0, 480, 3)), -1).reshape(-1, 2)
    hit = np.isfinite(first_hits(view.centre_m, view.rays(view.undistort(grid)), cones)).any(axis=1)
    agree = drawn[grid[:, 1], grid[:, 0]] == hit
    assert hit.sum() > 500
    assert (~agree).sum() < 0.06 * hit.sum()  # pixels that the rim cuts


def test_left_and_right_limbs_have_their_colours() -> None:
    view = camera()
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    draw_character(image, view, SKELETON, t_pose(SKELETON), ROOT)
    positions, _ = forward_kinematics(SKELETON, t_pose(SKELETON), ROOT)
    for side, bluer in (("l", True), ("r", False)):
        for joint in ("radius", "tibia"):
            x, y = np.rint(view.project(positions[SKELETON.index(side + joint)])).astype(int)
            blue, _, red = image[y, x].astype(int)
            assert (blue > red + 30) == bluer and (red > blue + 30) == (not bluer)


def test_nearer_limbs_hide_farther_ones() -> None:
    pose = t_pose(SKELETON)
    arm = rot.from_rotation_vector([0.0, -np.pi / 2.0, 0.0])
    pose[SKELETON.index("lhumerus")] = arm  # the left arm points forward, at the camera
    view = camera()
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    draw_character(image, view, SKELETON, pose, ROOT)
    positions, _ = forward_kinematics(SKELETON, pose, ROOT)
    hand = positions[SKELETON.index("lfingers")]
    assert hand[2] > 0.5
    x, y = np.rint(view.project(hand)).astype(int)
    assert image[y, x, 0] > image[y, x, 2] + 20


def test_ghost_lets_the_image_through() -> None:
    view = camera()
    solid, ghost = (np.full((480, 640, 3), 60, dtype=np.uint8) for _ in range(2))
    draw_character(solid, view, SKELETON, t_pose(SKELETON), ROOT, replace(preview.SOLVED, shadow=False))
    draw_character(ghost, view, SKELETON, t_pose(SKELETON), ROOT, replace(preview.SOLVED, shadow=False, opacity=0.25))
    changed = (solid != 60).any(axis=2)
    expected = 60.0 + 0.25 * (solid[changed].astype(float) - 60.0)
    assert np.abs(ghost[changed] - expected).max() <= 1.5


def test_shadow_falls_on_the_floor_below() -> None:
    view = camera()
    floor = preview.floor_image(view)
    image = floor.copy()
    draw_character(image, view, SKELETON, t_pose(SKELETON), ROOT)
    darker = (floor.astype(int) - image).min(axis=2) > 15
    x, y = np.rint(view.project([ROOT[0] - 0.42 * 0.6, 0.0, -0.4 * 0.6])).astype(int)  # a thigh's shadow
    assert darker[y - 6 : y + 7, x - 6 : x + 7].any()
    assert not darker[:100].any()


def test_character_outside_the_picture_draws_nothing() -> None:
    view = camera()
    image = np.full((480, 640, 3), 7, dtype=np.uint8)
    painter = preview.CharacterPainter(view, SKELETON)
    painter.draw(image, t_pose(SKELETON), [60.0, 1.0, 0.0])
    painter.draw(image, t_pose(SKELETON), view.centre_m + np.array([0.0, 0.0, 3.0]))
    assert (image == 7).all()


def test_detections_are_ringed_where_they_are() -> None:
    image = np.zeros((100, 200, 3), dtype=np.uint8)
    preview.draw_detections(image, [[50.0, 40.0]])
    rows, columns = np.nonzero(image[:, :58].any(axis=2))
    assert abs(rows.mean() - 40.0) < 1.5 and abs(columns.mean() - 50.0) < 1.5
    assert not image[:, 60:].any()
    preview.draw_caption(image, "left", "60 Hz")
    assert image[:30, 100:].any() or image[:30, :60].any()


def test_dim_images_are_brightened_in_order() -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    lifted = preview.brightened(ramp)[0, :, 0].astype(int)
    assert lifted[0] == 0 and lifted[255] == 255 and lifted[30] > 70
    assert np.all(np.diff(lifted) >= 0)


def test_pictures_side_by_side_have_one_height() -> None:
    joined = preview.side_by_side(np.zeros((40, 60, 3), np.uint8), np.full((80, 60, 3), 9, np.uint8))
    assert joined.shape == (40, 60 + 4 + 30, 3)
    assert (joined[:, -20:] == 9).all()


def test_video_opens_again(tmp_path: Path) -> None:
    frames = [np.full((120, 160, 3), level, dtype=np.uint8) for level in (40, 90, 140, 190)]
    assert write_video(tmp_path / "clip.mp4", frames, 30.0) == 4
    reader = cv2.VideoCapture(str(tmp_path / "clip.mp4"))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0)
    levels = [float(image.mean()) for ok, image in iter(reader.read, (False, None)) if ok]
    np.testing.assert_allclose(levels, [40, 90, 140, 190], atol=8)


def test_bad_videos_leave_nothing(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="no images"):
        write_video(tmp_path / "a.mp4", [], 30.0)
    frames = [np.zeros((48, 64, 3), np.uint8), np.zeros((50, 64, 3), np.uint8)]
    with pytest.raises(CaptureError, match="does not fit"):
        write_video(tmp_path / "a.mp4", frames, 30.0)
    assert list(tmp_path.iterdir()) == []


def test_contact_sheet(tmp_path: Path) -> None:
    frames = [np.full((30, 40, 3), 30 * i, dtype=np.uint8) for i in range(1, 6)]
    preview.write_contact_sheet(tmp_path / "sheet.png", frames, columns=3, width=316)
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape == (4 + 2 * (75 + 4), 316, 3)
    assert sheet[40, 50].tolist() == [30, 30, 30] and sheet[40 + 79, 50 + 104].tolist() == [150, 150, 150]
    with pytest.raises(CaptureError):
        preview.write_contact_sheet(tmp_path / "none.png", [])
