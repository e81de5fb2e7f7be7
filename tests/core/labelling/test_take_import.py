"""Takes of other systems: whichever axis points up, whatever the markers are called, wherever the floor is."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import TakeError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rigid_transform import kabsch
from perfanim.core.labelling.take_import import import_take
from perfanim.core.markers.floor_from_feet import floor_points
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.simulate.studio.studio_rig import default_rig

SET = load_marker_set("locomotion")
FPS = 30.0
# which axes of a file's world are right, up and to the front, for every axis that may point up
AXES = {
    "y": ("x", "y", "z"),
    "z": ("x", "z", "-y"),
    "-y": ("x", "-y", "-z"),
    "-z": ("x", "-z", "y"),
    "x": ("-y", "x", "z"),
    "-x": ("y", "-x", "z"),
}


def axis(name):
    return (-1.0 if name.startswith("-") else 1.0) * np.eye(3)["xyz".index(name[-1])]


def turn_to(up):
    """The rotation (3, 3) from our world to a file's."""
    return np.column_stack([axis(name) for name in AXES[up]])


@pytest.fixture(scope="module")
def stand():
    """A person who stands and sways a little, with two of the markers at times seen by one camera alone."""
    generator = np.random.default_rng(0)
    skeleton = default_skeleton()
    root = np.array([0.2, 0.95, 0.3])
    row = SET.positions_on(skeleton, standing(skeleton), root)
    sway = 0.01 * np.sin(np.arange(30) / 5.0)[:, None, None] * np.array([1.0, 0.0, 1.0])
    positions = row + sway * (row[:, 1:2] / 1.5) + generator.normal(scale=0.001, size=(30, 8, 3))
    return MarkerTake("stand", FPS, SET.names, positions)


def moved(take, turn, shift=(0.0, 0.0, 0.0)):
    return replace(take, positions_m=take.positions_m @ turn.T + np.array(shift))


def few(take):
    return MarkerTake(take.name, take.fps, take.names, take.positions_m[:2])


def unnamed(take, order):
    return replace(take, names=tuple(f"M{i}" for i in range(8)), positions_m=take.positions_m[:, order])


@pytest.mark.parametrize("up", AXES)
def test_up_axis_is_found_or_given(stand, up):
    file = moved(stand, turn_to(up))
    for given in ("auto", up) if up in ("y", "z") else ("auto",):
        found = import_take(file, SET, given)
        assert found.names == SET.names
        np.testing.assert_allclose(found.positions_m, stand.positions_m, atol=1e-9)


@pytest.mark.parametrize("name", ["locomotion", "boxing", "kendo", "two-webcams"])
@pytest.mark.parametrize("up", AXES)
def test_unnamed_markers_are_named_for_any_up_axis(name, up):
    worn = load_marker_set(name)
    skeleton = default_skeleton(1.7)
    places = worn.positions_on(skeleton, standing(skeleton))
    order = np.random.default_rng(5).permutation(len(worn))
    take = MarkerTake("stand", FPS, tuple(f"M{i}" for i in range(len(worn))), places[None, order])
    found = import_take(moved(take, turn_to(up)), worn, "auto")
    assert found.names == worn.names
    np.testing.assert_allclose(found.positions_m[0], places, atol=1e-9)


@pytest.mark.parametrize(("up", "given"), [("y", "auto"), ("y", "y"), ("z", "auto"), ("z", "z")])
def test_unnamed_markers_are_named_by_their_places(stand, up, given):
    order = np.random.default_rng(3).permutation(8)
    found = import_take(unnamed(moved(few(stand), turn_to(up)), order), SET, given)
    assert found.names == SET.names
    np.testing.assert_allclose(found.positions_m, stand.positions_m[:2], atol=1e-9)


def test_given_axis_is_used_for_lying_bodies(stand):
    lying = moved(stand, turn_to("z"))
    np.testing.assert_array_equal(import_take(lying, SET, "y").positions_m, lying.positions_m)


def test_other_spellings_are_renamed(stand):
    extra = np.full((30, 1, 3), 0.5)
    names = (*(f"Anna:{name.lower()}" for name in SET.names), "wand")
    file = replace(stand, names=names, positions_m=np.concatenate((stand.positions_m, extra), axis=1))
    assert import_take(file, SET, "y").names == (*SET.names, "wand")
    doubled = replace(file, names=(*SET.names, "anna:" + SET.names[0]))
    assert import_take(doubled, SET, "y").names == doubled.names


def shown_alone(take, rig):
    """The take with every marker hidden in some frames from all but one camera."""
    positions, cameras = take.positions_m.copy(), np.full(take.visible.shape, -1)
    points = np.full((*cameras.shape, 2), np.nan)
    for marker in range(8):
        frame, index = 2 * marker, marker % 2
        camera = rig.cameras[index]
        cameras[frame, marker] = index
        points[frame, marker] = camera.undistort(camera.project(positions[frame, marker]))
        positions[frame, marker] = np.nan
    return replace(take, positions_m=positions, single=SingleViews(rig, cameras, points))


def seen_by(rig, positions_m):
    return np.stack([camera.project(positions_m) for camera in rig.cameras])


@pytest.mark.parametrize("up", ["auto", "feet"])
def test_cameras_move_with_the_world(stand, up):
    """Before and after, every camera sees every marker at the same place in its image."""
    turn, shift = turn_to("z"), np.array([0.5, -0.3, 0.4])
    file, rig = moved(stand, turn, shift), default_rig()
    cameras = tuple(
        replace(camera, rotation=camera.rotation @ turn.T,
                translation_m=camera.translation_m - camera.rotation @ turn.T @ shift)
        for camera in rig.cameras
    )  # fmt: skip
    file = shown_alone(file, CameraRig(cameras, {"note": "kept"}))
    found = import_take(file, SET, up)
    np.testing.assert_allclose(seen_by(found.single.rig, found.positions_m), seen_by(file.single.rig, file.positions_m))
    assert found.single.rig.metadata == {"note": "kept"}
    np.testing.assert_array_equal(found.single.cameras, file.single.cameras)
    np.testing.assert_array_equal(found.single.points, file.single.points)


@pytest.mark.parametrize("height_m", [-0.4, 0.7])
def test_floor_under_the_feet_becomes_zero(stand, height_m):
    tilt = rot.to_matrix(rot.from_rotation_vector(np.array([0.06, 0.0, -0.04])))
    found = import_take(moved(stand, tilt, (1.0, height_m, 2.0)), SET, "feet")
    np.testing.assert_allclose(floor_points(found, SET)[:, 1], 0.0, atol=1e-9)
    level = import_take(stand, SET, "feet")
    np.testing.assert_allclose(found.positions_m[..., 1], level.positions_m[..., 1], atol=1e-3)
    # turned the shortest way, and lifted straight: heading and place are kept
    turn, _ = kabsch(moved(stand, tilt).positions_m[0], found.positions_m[0])
    assert rot.angle_between(rot.from_matrix(turn), rot.identity()) < 1.2 * np.hypot(0.06, 0.04)
    floor = turn @ floor_points(moved(stand, tilt, (1.0, height_m, 2.0)), SET).mean(axis=0)
    np.testing.assert_allclose(floor_points(found, SET).mean(axis=0)[[0, 2]], floor[[0, 2]], atol=1e-9)


def test_take_of_one_camera_is_unchanged(stand):
    rig = default_rig(1)
    nothing = np.full((30, 8, 3), np.nan)
    single = SingleViews(rig, np.zeros((30, 8), dtype=np.int64), np.zeros((30, 8, 2)))
    file = replace(stand, names=tuple("ABCDEFGH"), positions_m=nothing, single=single)
    assert import_take(file, SET, "auto") is file


def test_other_markers_are_refused(stand):
    named = replace(stand, names=tuple("ABCDEFGH"))
    fewer = MarkerTake("few", FPS, tuple("ABCDEFG"), stand.positions_m[:, :7])
    with pytest.raises(
        TakeError, match="its markers are called A, B, C, D, E, F, G, but those of the set locomotion are called LSHO"
    ):
        import_take(fewer, SET, "auto")
    anywhere = replace(named, positions_m=np.random.default_rng(1).uniform(-3.0, 3.0, stand.positions_m.shape))
    for up in ("auto", "y"):
        with pytest.raises(TakeError, match="positions do not fit the marker set") as told:
            import_take(few(anywhere), SET, up)
        assert "choose the marker set that was worn" in told.value.advice
        assert told.value.where == "stand"


def test_too_few_markers_for_the_vertical_are_refused(stand):
    positions = np.full_like(stand.positions_m, np.nan)
    for f in range(30):
        positions[f, [f % 8, (f + 1) % 8, (f + 2) % 8]] = 0.3
    with pytest.raises(TakeError, match="too few markers are seen at once to find the vertical") as told:
        import_take(replace(stand, positions_m=positions), SET, "auto")
    assert told.value.advice == "say which axis points up"
