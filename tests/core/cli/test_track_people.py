"""A person without markers, by `perfanim track --people` and `solve`: films of a man who balances on a beam."""

import json

import cv2
import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.network_file import body_network_file


@pytest.fixture
def tracked(shared_dir, tmp_path, capsys):
    """tracked(1, 4) -> the take by these of the four cameras."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"

    def track(*numbers, out="beam.take.npz", more=()):
        cameras = [word for n in numbers for word in ("--camera", f"cam0{n}={films / f'cam0{n}.mp4'}")]
        line = ["track", "--cameras", films / "Calib.qca.txt", *cameras, "--people", "--seconds", 1.0]
        assert main([*map(str, line), "--out", str(tmp_path / out), "--json", *more]) == 0
        return json.loads(capsys.readouterr().out)

    return track


@pytest.mark.long
def test_one_film_becomes_motion(tracked, tmp_path, capsys):
    told = tracked(4)
    assert (told["frames"], told["labels"]) == (60, "those of the body network")
    line = ["solve", tmp_path / "beam.take.npz", "--height", 1.61, "--out", tmp_path / "beam.bvh", "--json"]
    assert main(list(map(str, line))) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["confidence"] < 0.5
    motion = read_motion(tmp_path / "beam.bvh")
    joints_m, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    assert np.ptp(joints_m[0, :, 1]) == pytest.approx(1.5, abs=0.2)  # he stands
    (camera,) = read_take(tmp_path / "beam.take.npz").single.rig.cameras
    assert np.median(camera.to_camera(motion.root_positions_m)[:, 2]) == pytest.approx(3.1, abs=0.3)


@pytest.mark.long
def test_two_films_become_motion(tracked, tmp_path, capsys):
    told = tracked(1, 4, more=("--floor", "feet"))
    heights_mm = told["camera_heights_mm"]  # above the beam; 1.9 m above the calibration's floor
    assert set(heights_mm) == {"cam01", "cam04"} and all(500.0 < height < 1900.0 for height in heights_mm.values())
    assert (told["markers"], told["frames"], told["labels"]) == (33, 60, "those of the body network")
    assert main(["solve", str(tmp_path / "beam.take.npz"), "--out", str(tmp_path / "beam.bvh"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["marker_set"] == "blazepose-33"
    motion = read_motion(tmp_path / "beam.bvh")
    joints_m, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    points = read_take(tmp_path / "beam.take.npz")
    wrists_m = points.positions_m[:, [points.names.index(f"{side}_wrist") for side in ("left", "right")]]
    solved_m = joints_m[:, [motion.skeleton.index(name) for name in ("lwrist", "rwrist")]]
    feet_m = joints_m[:, [motion.skeleton.index(name) for name in ("lfoot", "rfoot", "ltoes", "rtoes")], 1]
    assert abs(np.median(feet_m.min(axis=1))) < 0.06
    assert np.median(np.linalg.norm(solved_m - wrists_m, axis=-1)) < 0.1
    trembling_m = [np.linalg.norm(np.diff(each, 2, axis=0), axis=-1).mean() for each in (solved_m, wrists_m)]
    assert trembling_m[0] < trembling_m[1] / 3.0


def test_options_of_markers_are_refused_with_people(tmp_path, capsys):
    line = ["track", "--cameras", "a.toml", "--left", "a.mp4", "--right", "b.mp4", "--people", "--out", "a.take.npz"]
    assert main([*line, "--marker-set", "boxing"]) == 1
    assert "--marker-set is for markers, not for --people" in capsys.readouterr().err


def test_a_missing_network_is_told(shared_dir, tmp_path, capsys):
    films = shared_dir / "people" / "walk-on-beam"
    line = ["track", "--cameras", films / "Calib.qca.txt", "--camera", f"cam01={films / 'cam01.mp4'}"]
    line += ["--camera", f"cam02={films / 'cam02.mp4'}", "--people", tmp_path / "none.tflite", "--out", "a.take.npz"]
    assert main(list(map(str, line))) == 1
    assert "none.tflite: there is no body network; get the body network first" in capsys.readouterr().err


def test_films_of_nobody_are_told_and_leave_nothing(tmp_path, capsys):
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    rig = default_rig()
    save_rig(rig, tmp_path / "cameras.toml")
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for number in range(2):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), np.full((480, 640, 3), 90, dtype=np.uint8))
    line = ["track", "--cameras", tmp_path / "cameras.toml", "--left", tmp_path / "left", "--right", tmp_path / "right"]
    assert main([*map(str, line), "--fps", "30", "--people", "--out", str(tmp_path / "a.take.npz")]) == 1
    assert "nobody was found in the images of left and right; check the light" in capsys.readouterr().err
    assert not (tmp_path / "a.take.npz").exists()
