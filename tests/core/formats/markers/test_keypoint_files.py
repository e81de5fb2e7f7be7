"""Arrays and tables of markerless tools: FreeMoCap's layouts, by their public description."""

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import READABLE, read_take
from perfanim.core.markers.label_matching import match_best_set
from perfanim.core.markers.marker_set import load_marker_set

FRAMES = 6
SET = load_marker_set("blazepose-33")
HEIGHT_M = 1.75


@pytest.fixture(scope="module")
def points_mm():
    """Keypoints (F, 33, 3) of a person who glides, millimetres, z up."""
    skeleton = default_skeleton(HEIGHT_M)
    still = SET.positions_on(skeleton, standing(skeleton), (0.0, 0.95, 0.0))
    metres = still + np.arange(FRAMES)[:, None, None] * np.array([0.0, 0.0, 0.01])
    return 1000.0 * metres[..., [0, 2, 1]] * [1.0, -1.0, 1.0]


def wide(points, prefix, head=(), fields=()):
    header = [*head, *(f"{prefix}{name}_{axis}" for name in SET.names for axis in "xyz")]
    rows = [[*(row[frame] for row in fields), *map(repr, map(float, points[frame].ravel()))] for frame in range(FRAMES)]
    return "\n".join(",".join(row) for row in [header, *rows]) + "\n"


def check(take, points, fps):
    np.testing.assert_allclose(take.positions_m, 1e-3 * points, atol=1e-9)
    assert take.fps == pytest.approx(fps)
    match = match_best_set(take.names, "")
    assert (match.marker_set.name, len(match.label_of)) == (SET.name, 33)


@pytest.mark.parametrize("prefix", ["", "body_"])
def test_table_of_a_model_has_neither_rate_nor_unit(points_mm, tmp_path, prefix):
    (tmp_path / "mediapipe_body_3d_xyz.csv").write_text(wide(points_mm, prefix))
    take = read_take(tmp_path / "mediapipe_body_3d_xyz.csv")
    check(take, points_mm, 30.0)
    assert take.notes == ("neither a rate nor times are stated: 30 frames per second are assumed",)
    np.testing.assert_allclose(take.times_s, np.arange(FRAMES) / 30.0)


@pytest.mark.parametrize(
    "stamps",
    [
        [f"{1.7e9 + frame / 25:.3f}" for frame in range(FRAMES)],
        [f"{3e12 + 4e7 * frame:.1f}" for frame in range(FRAMES)],
        [f"2026-10-12 15:30:3{frame * 0.04:.2f}+00:00" for frame in range(FRAMES)],
    ],
    ids=["seconds", "nanoseconds", "dates"],
)
def test_table_by_trajectory_has_times(points_mm, tmp_path, stamps):
    table = wide(points_mm, "body_", ("timestamp", "timestamp_by_camera"), (stamps, ["{}"] * FRAMES))
    hands = table.splitlines()
    hands = [hands[0] + ",left_hand_0000_x,left_hand_0000_y,left_hand_0000_z", *(row + ",1,2,3" for row in hands[1:])]
    (tmp_path / "walk_by_trajectory.csv").write_text("\n".join(hands))
    take = read_take(tmp_path / "walk_by_trajectory.csv")
    check(take, points_mm, 25.0)
    assert take.notes == ()


def by_frame(points, columns, kinds):
    """Return a table with a row per point; columns maps their names to texts of a frame and a point."""
    lines = [",".join(columns)]
    for kind, shift in kinds:
        for frame in range(FRAMES):
            for name, point in zip(SET.names, points[frame] + shift, strict=True):
                values = dict(zip("xyz", map(str, point), strict=True), frame=str(frame), keypoint=name, **kind)
                lines.append(",".join(values.get(column, "") for column in columns))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("columns", "kinds"),
    [
        ("frame,timestamp,timestamp_by_camera,model,keypoint,x,y,z,reprojection_error",
         [({"model": "mediapipe_body", "timestamp_by_camera": "{}"}, 0.0), ({"model": "mediapipe_hand"}, 9.0)]),
        ("frame,keypoint,x,y,z,model,trajectory,reprojection_error",
         [({"model": "mediapipe.body", "trajectory": "rigid_3d_xyz"}, 7.0),
          ({"model": "mediapipe.body", "trajectory": "3d_xyz"}, 0.0)]),
        ("frame,keypoint,x,y,z", [({}, 0.0)]),
    ],
    ids=["version 1", "version 2", "of one trajectory"],
)  # fmt: skip
def test_table_by_frame_is_gathered(points_mm, tmp_path, columns, kinds):
    points_mm = points_mm.copy()
    points_mm[2, 5] = np.nan  # not triangulated: no row says so, or a row without numbers
    (tmp_path / "walk_by_frame.csv").write_text(by_frame(points_mm, columns.split(","), kinds))
    check(read_take(tmp_path / "walk_by_frame.csv"), points_mm, 30.0)


@pytest.mark.parametrize("count", [33, 553])
def test_array_is_named_by_its_number_of_points(points_mm, tmp_path, count):
    whole = np.full((FRAMES, count, 3), 4.0)
    whole[:, :33] = points_mm
    np.save(tmp_path / "points.npy", whole)
    take = read_take(tmp_path / "points.npy")
    check(take, points_mm, 30.0)
    assert "by their number" in take.notes[-1]
    np.save(tmp_path / "metres.npy", 1e-3 * points_mm.astype(np.float32))
    np.testing.assert_allclose(read_take(tmp_path / "metres.npy").positions_m, 1e-3 * points_mm, atol=1e-6)


def test_times_come_from_the_folder_of_the_recording(points_mm, tmp_path):
    stamps = tmp_path / "walk" / "synchronized_videos" / "timestamps"
    output = tmp_path / "walk" / "output_data"
    stamps.mkdir(parents=True)
    output.mkdir()
    for camera in range(2):
        np.save(stamps / f"camera_{camera}.npy", 3e12 + 2e7 * np.arange(FRAMES) + 1e6 * camera)
    np.save(output / "mediapipe_body_3d_xyz.npy", points_mm)
    (output / "mediapipe_body_3d_xyz.csv").write_text(wide(points_mm, "body_"))
    for ending in ("npy", "csv"):
        take = read_take(output / f"mediapipe_body_3d_xyz.{ending}")
        check(take, points_mm, 50.0)
        assert not any("assumed" in note for note in take.notes)
    (stamps / "camera_0.npy").write_bytes(b"damaged")
    take = read_take(output / "mediapipe_body_3d_xyz.npy")
    check(take, points_mm, 50.0)
    assert any("a camera's times are not used: camera_0.npy" in note for note in take.notes)


def test_wrong_arrays_and_tables_are_refused(points_mm, tmp_path):
    assert ".npy" in READABLE
    path = tmp_path / "a.npy"
    for array, problem in (
        (points_mm[:, :20], r"shape \(6, 20, 3\), which cannot be keypoints; .*33 \(blazepose-33\)"),
        (points_mm[..., :2], "which cannot be keypoints"),
        (points_mm[0], "which cannot be keypoints"),
        (np.zeros((0, 33, 3)), "never shows most of the body in one frame"),
        (np.full((5, 33, 3), np.nan), "never shows most of the body in one frame"),
    ):
        np.save(path, array)
        with pytest.raises(FormatError, match=problem):
            read_take(path)
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    for data in (path.read_bytes(), b"\x93NUMPY", b"<!doctype html><html></html>", b""):
        path.write_bytes(data)
        with pytest.raises(FormatError):
            read_take(path)
    table = tmp_path / "a.csv"
    table.write_text("frame,keypoint,x,y,z\n")
    with pytest.raises(FormatError, match="has no frames"):
        read_take(table)
    table.write_text("frame,keypoint,x,y,z\n0,nose,1,2,three\n")
    with pytest.raises(FormatError, match=r"a\.csv, line 2: has a field that is not a number"):
        read_take(table)
    table.write_text(wide(points_mm, "P_").replace("nose", "n").replace("left", "a").replace("right", "b"))
    with pytest.raises(FormatError, match="states neither fps nor times"):
        read_take(table)
