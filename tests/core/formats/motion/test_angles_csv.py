"""Joint angles as a table: another library makes the rotations of them again."""

import csv

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.angles_csv import write_angles_csv
from perfanim.core.geometry import rotations as rot
from scipy.spatial.transform import Rotation

DECIMALS = 1e-6


def read(path):
    """Return comments, header and columns by name."""
    lines = path.read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    rows = list(csv.reader(lines[len(comments) :]))
    table = np.array(rows[1:], dtype=float)
    return comments, rows[0], dict(zip(rows[0], table.T, strict=True))


def test_the_rotations_come_out_again(truth, tmp_path):
    write_angles_csv(truth, tmp_path / "walk.angles.csv")
    comments, header, columns = read(tmp_path / "walk.angles.csv")
    assert "fps=30.0" in comments[0]
    assert header[:5] == ["frame", "time_s", "root_x_m", "root_y_m", "root_z_m"]
    assert len(header) == 5 + 3 * len(truth.skeleton)
    np.testing.assert_array_equal(columns["frame"], np.arange(truth.frames))
    np.testing.assert_allclose(columns["time_s"], np.arange(truth.frames) / 30.0, atol=DECIMALS)
    places = np.stack([columns[f"root_{axis}_m"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(places, truth.root_positions_m, atol=DECIMALS)
    for joint, name in enumerate(truth.skeleton.names):
        angles = np.stack([columns[f"{name}_{axis}_deg"] for axis in "zxy"], axis=1)
        x, y, z, w = Rotation.from_euler("ZXY", angles, degrees=True).as_quat().T  # upper case: intrinsic
        again = np.stack((w, x, y, z), axis=1)
        # three angles, each rounded to the last decimal
        assert np.degrees(rot.angle_between(again, truth.rotations[:, joint])).max() < 3 * DECIMALS, name


def test_angles_go_on_without_jumps_where_the_body_turns_and_bends(tmp_path):
    skeleton = default_skeleton()
    turns = rot.identity((200, len(skeleton)))
    bend = skeleton.index("lowerback")
    zeros = np.zeros(200)
    turns[:, 0] = rot.from_euler(np.radians(np.stack((zeros, zeros, np.linspace(0, 720, 200)), axis=1)), "ZXY")
    turns[:, bend] = rot.from_euler(np.radians(np.stack((zeros, np.linspace(0, 150, 200), zeros), axis=1)), "ZXY")
    write_angles_csv(Motion("turn", 60.0, skeleton, turns, np.zeros((200, 3))), tmp_path / "turn.angles.csv")
    columns = read(tmp_path / "turn.angles.csv")[2]
    np.testing.assert_allclose(columns["root_y_deg"], np.linspace(0, 720, 200), atol=1e-5)
    np.testing.assert_allclose(columns["lowerback_x_deg"], np.linspace(0, 150, 200), atol=1e-5)


def test_it_is_not_taken_for_markers(truth, tmp_path):
    write_angles_csv(truth, tmp_path / "walk.angles.csv")
    with pytest.raises(FormatError, match="is not a marker take"):
        read_take(tmp_path / "walk.angles.csv")
