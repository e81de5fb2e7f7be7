"""Markers and skeleton over the viewport: what is drawn where."""

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from mathutils import Matrix
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.scene_pose import DOUBTFUL_PART_DEG, PerformerPose, ScenePose, body_confidence
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.common_space import common_space
from perfanim.perfanim_addon.viewport import overlay

SKELETON = default_skeleton()
ROOT_M = np.array([0.0, 1.0, 0.0])
NAMES = ("SEEN", "LOST", "ALONE")
CAMERAS_M = np.array([[0.5, 1.0, 3.0], [-0.5, 1.0, 3.0]])
MARKERS_M = np.array([[0.2, 1.5, 0.1], [-0.2, 0.5, 0.1], [0.0, 1.1, 0.2]])
SEEN_M = np.array([0.21, 1.51, 0.1])  # a little off the marker of the solved body
NOWHERE_M = np.full(3, np.nan)
PX = 100.0  # to a metre


def pose(confidence: float = 1.0) -> PerformerPose:
    return PerformerPose(
        7, 0.1, rot.identity((len(SKELETON.names),)), ROOT_M, confidence, MARKERS_M,
        np.stack([SEEN_M, NOWHERE_M, NOWHERE_M]), np.array([-1, -1, 1]), 0.01,
    )  # fmt: skip


def from_the_front(points_m: np.ndarray) -> np.ndarray:
    return PX * points_m[..., :2]


def drawn(parts: set[str], confidence: float = 1.0) -> Any:
    scene = overlay.Scene(((SKELETON, NAMES),), CAMERAS_M, lambda points_m: points_m)
    return overlay.shapes_of(scene, ScenePose((pose(confidence),)), frozenset(parts), from_the_front, 1.0)


def reached(shapes: Any, place_m: np.ndarray, within_px: float) -> list[tuple[float, ...]]:
    """Colours of what is drawn so near to a place."""
    corners = np.concatenate(shapes.corners)
    near = np.linalg.norm(corners - PX * place_m[:2], axis=1) <= within_px
    return [colour for colour, is_near in zip(shapes.colours, near.tolist(), strict=True) if is_near]


def test_markers_are_dots_rings_and_lines_to_the_camera_that_alone_sees_them() -> None:
    shapes, names = drawn({"MARKERS"})
    assert reached(shapes, SEEN_M, 0.1)  # a dot, filled to its centre, where it was located
    for lost in MARKERS_M[1:]:
        assert reached(shapes, lost, 6.0)
    assert not reached(shapes, MARKERS_M[1], 3.0)  # a ring is empty
    assert reached(shapes, CAMERAS_M[1], 1.0)
    assert not reached(shapes, CAMERAS_M[0], 20.0)
    assert len({reached(shapes, place, 6.0)[-1] for place in (SEEN_M, *MARKERS_M[1:])}) == len(NAMES)
    assert [name for name, _ in names] == list(NAMES)
    for (_, place), marker_m in zip(names, (SEEN_M, *MARKERS_M[1:]), strict=True):
        np.testing.assert_allclose(place, PX * marker_m[:2])


def test_keypoints_are_drawn_without_their_names() -> None:
    worn = load_marker_set("blazepose-33").subset(("left_shoulder", "right_shoulder", "left_hip"))
    performer = Subject("Anna", SKELETON, worn)
    scene = overlay.Scene.of([performer], None, lambda points_m: points_m)
    shapes, names = overlay.shapes_of(scene, ScenePose((pose(),)), frozenset({"MARKERS"}), from_the_front, 1.0)
    assert reached(shapes, SEEN_M, 0.1)
    assert names == []


def test_names_that_had_to_go_away_have_a_line_to_their_markers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overlay.viewport_drawing, "text_width", lambda line, size: 0.6 * size * len(line))
    for apart_px, has_line in ((200.0, False), (3.0, True)):
        shapes = overlay.Shapes()
        names = [(name, np.array([100.0, 100.0 + apart_px * number])) for number, name in enumerate(NAMES)]
        placed = overlay._placed(shapes, names)
        assert [name for name, _ in placed] == list(NAMES)
        assert bool(shapes.corners) == has_line
    assert overlay._placed(overlay.Shapes(), []) == []


def test_the_skeleton_is_green_where_it_is_sure_and_red_where_it_is_guessed() -> None:
    positions_m, _ = forward_kinematics(SKELETON, pose().rotations, ROOT_M)
    for confidence, colour in ((1.0, (0.0, 1.0, 0.0, 1.0)), (0.0, (1.0, 0.0, 0.0, 1.0))):
        shapes, names = drawn({"SKELETON"}, confidence)
        assert names == []
        assert set(shapes.colours) == {colour}
        for place_m in positions_m:
            assert reached(shapes, place_m, 2.0)


def test_a_limb_that_is_guessed_is_red_on_a_green_body() -> None:
    limit_deg = DOUBTFUL_PART_DEG * np.where([part == "left arm" for part in PARTS], 2.0, 0.0)
    guessed = replace(pose(body_confidence(limit_deg)), part_errors_deg=limit_deg)
    scene = overlay.Scene(((SKELETON, NAMES),), CAMERAS_M, lambda points_m: points_m)
    shapes, _ = overlay.shapes_of(scene, ScenePose((guessed,)), frozenset({"SKELETON"}), from_the_front, 1.0)
    positions_m, _ = forward_kinematics(SKELETON, guessed.rotations, ROOT_M)
    elbow_m, knee_m = (positions_m[SKELETON.index(joint)] for joint in ("lradius", "rtibia"))
    assert min(colour[1] for colour in reached(shapes, elbow_m, 2.0)) < 0.1
    assert set(reached(shapes, knee_m, 2.0)) == {(0.0, 1.0, 0.0, 1.0)}


def test_the_space_that_all_cameras_see_lies_on_the_floor_with_its_size() -> None:
    space = common_space(default_rig())
    scene = overlay.Scene(((SKELETON, NAMES),), CAMERAS_M, lambda points_m: points_m, default_rig())

    def from_above(points_m: np.ndarray) -> np.ndarray:
        assert np.all(points_m[:, 1] == 0.0)
        return PX * points_m[:, [0, 2]]

    shapes, names = overlay.shapes_of(scene, ScenePose((pose(),)), frozenset({"SPACE"}), from_above, 1.0)
    left, back, right, front = space.rectangle_m
    for x, z in ((left, back), (right, back), (right, front), (left, front), (0.5 * (left + right), front)):
        assert reached(shapes, np.array([x, z]), 20.0)
    assert not reached(shapes, np.array([left + right, back + front]) / 2.0, 10.0)
    assert [text for text, _ in names] == [space.text]


def test_without_a_floor_no_space_is_drawn() -> None:
    rig = default_rig()
    for simulated, there in ((False, False), (True, True)):
        scene = overlay.Scene.of([], rig, from_the_front, simulated)
        shapes, _ = overlay.shapes_of(scene, ScenePose(()), frozenset({"SPACE"}), from_the_front, 1.0)
        assert bool(shapes.corners) == there


def test_all_performers_are_drawn() -> None:
    aside_m = np.array([1.5, 0.0, 0.0])
    other = replace(
        pose(0.0), root_position_m=ROOT_M + aside_m, markers_m=MARKERS_M + aside_m, observed_m=MARKERS_M + aside_m
    )
    scene = overlay.Scene(((SKELETON, NAMES), (SKELETON, ("A", "B", "C"))), CAMERAS_M, lambda points_m: points_m)
    both = ScenePose((pose(), other))
    shapes, names = overlay.shapes_of(scene, both, frozenset({"MARKERS", "SKELETON"}), from_the_front, 1.0)
    assert [name for name, _ in names] == [*NAMES, "A", "B", "C"]
    assert reached(shapes, ROOT_M, 2.0) and reached(shapes, ROOT_M + aside_m, 2.0)
    assert {(0.0, 1.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)} <= set(shapes.colours)  # each as sure as it is


def test_what_is_behind_the_viewer_is_not_in_sight() -> None:
    size = np.array([800.0, 600.0])
    lens = Matrix(((2.0, 0, 0, 0), (0, 2.0, 0, 0), (0, 0, -1.0, -0.2), (0, 0, -1.0, 0)))  # looks along -z
    matrix = np.array(lens)
    seen = overlay.projected(matrix, size, np.array([[0.0, 0.0, -5.0], [1.0, 0.0, -4.0], [0.0, 0.0, 5.0]]))
    np.testing.assert_allclose(seen[:2], [[400.0, 300.0], [600.0, 300.0]])
    assert np.isnan(seen[2]).all()
    shapes = overlay.Shapes()
    shapes.line(seen[0], seen[2], 1.0, (1.0, 1.0, 1.0, 1.0))
    assert not shapes.corners


def test_it_is_drawn_only_while_something_is_chosen(addon: ModuleType) -> None:
    scene = overlay.Scene(((SKELETON, NAMES),), CAMERAS_M, lambda points_m: points_m)
    overlay.show(scene, ScenePose((pose(),)), frozenset())
    assert not overlay.handler.added
    overlay.show(scene, ScenePose((pose(),)), frozenset({"MARKERS"}))
    assert overlay.handler.added
    overlay.show(scene, ScenePose((pose(),)), frozenset())
    assert overlay._state == overlay._State(parts=frozenset({"MARKERS"}))


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_scene_is_that_of_the_capture(calibrated: bool) -> None:
    from perfanim.core.geometry.camera import CameraRig

    marker_set, rig = load_marker_set("boxing"), default_rig()
    calibration = CameraRig(rig.cameras[:1], rig.metadata) if calibrated else None
    scene = overlay.Scene.of([Subject("Anna", SKELETON, marker_set)], calibration, from_the_front)
    assert scene.performers[0][1] == marker_set.names
    wanted = [camera.centre_m for camera in rig.cameras[: 1 if calibrated else 2]]
    np.testing.assert_allclose(scene.cameras_m, wanted, atol=1e-9)
