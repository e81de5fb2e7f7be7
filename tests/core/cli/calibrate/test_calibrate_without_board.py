"""`perfanim calibrate cameras` without a board: options, films of nobody, a waved marker, a man on a beam."""

import json
import logging
from dataclasses import replace

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.simulate.studio.discs import draw_disc
from perfanim.core.vision.people.network_file import body_network_file
from walked_rooms import angles_and_distances, room, waved

LOG = logging.getLogger(__name__)  # `pytest --log-cli-level=INFO` shows the figures


def line(folder, *options):
    sources = ["--left", str(folder / "left"), "--right", str(folder / "right")]
    return ["calibrate", "cameras", *sources, "--out", str(folder / "cameras.toml"), *map(str, options)]


def write_pictures(folder, pictures):
    for side, images in zip(("left", "right"), pictures, strict=True):
        (folder / side).mkdir()
        for number, image in enumerate(images):
            cv2.imwrite(str(folder / side / f"{number:03d}.png"), image)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--by-marker",), "--by-marker needs --apart; measure the distance between the first two cameras"),
        (("--by-marker", "--by-stick", "500"), "--by-marker and --by-stick exclude each other"),
        (("--by-stick", "500", "--height", "1.8"), "--height is not for --by-stick"),
        (("--by-walking", "--board", "chessboard:9x6:24mm"), "--board is not for --by-walking"),
        (("--by-walking", "--height", "180"), "--height 180 is out of range; give metres"),
        (("--by-stick", "0.5"), "--by-stick 0.5 is out of range; give millimetres"),
    ],
)
def test_options_that_contradict_each_other_are_told(tmp_path, capsys, options, told):
    assert main(line(tmp_path, *options)) == 1
    assert told in capsys.readouterr().err


@pytest.mark.long
def test_films_of_nobody_are_told_and_leave_nothing(tmp_path, capsys):
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    write_pictures(tmp_path, [[np.full((480, 640, 3), 90, dtype=np.uint8)] * 2] * 2)
    assert main(line(tmp_path, "--by-walking")) == 1
    assert "nobody was found in the pictures of left; walk about for 20 s" in capsys.readouterr().err
    assert not (tmp_path / "cameras.toml").exists()


@pytest.mark.long
def test_pictures_of_a_waved_marker_calibrate(tmp_path, capsys):
    cameras = room(21)
    pictures = [[], []]
    for point in waved(6.0, 21)[:, 0]:
        for camera, images in zip(cameras, pictures, strict=True):
            image = np.zeros((480, 640, 3), dtype=np.uint8)
            draw_disc(image, camera.project(point)[None], 4.0, np.full(3, 230.0), 0.6)
            images.append(image)
    write_pictures(tmp_path, pictures)
    named = [replace(each, name=name) for name, each in zip(("left", "right"), cameras, strict=True)]
    save_rig(CameraRig(tuple(named)), tmp_path / "lenses.toml")
    apart_m = np.linalg.norm(cameras[0].centre_m - cameras[1].centre_m)
    options = ("--by-marker", "--apart", apart_m, "--lenses", tmp_path / "lenses.toml", "--json")
    assert main(line(tmp_path, *options)) == 0
    told = json.loads(capsys.readouterr().out)
    assert {"verdict", "advice", "stereo_rms_px", "rms_px", "baseline_mm", "used", "rejected"} <= told.keys()
    assert told["baseline_mm"] == pytest.approx(1e3 * apart_m)
    angles_deg, _ = angles_and_distances(load_rig(tmp_path / "cameras.toml").cameras, cameras)
    assert angles_deg.max() < 0.1


@pytest.mark.long
@pytest.mark.parametrize("lenses", ["known", "unknown"])
def test_a_man_on_a_beam_calibrates_as_well_as_is_told(shared_dir, tmp_path, capsys, lenses):
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"
    sources = [word for n in range(1, 5) for word in ("--camera", f"cam0{n}={films / f'cam0{n}.mp4'}")]
    known = ["--lenses", str(films / "Calib.qca.txt")] if lenses == "known" else []
    out = ["--height", "1.72", "--out", str(tmp_path / "cameras.toml"), "--json"]
    assert main(["calibrate", "cameras", "--by-walking", *sources, *known, *out]) == 0
    told = json.loads(capsys.readouterr().out)
    found, true = load_rig(tmp_path / "cameras.toml").cameras, load_rig(films / "Calib.qca.txt").cameras
    angles_deg, distances = angles_and_distances(found, true)
    ratios = (1.0 + distances) / np.median(1.0 + distances) - 1.0
    LOG.info(
        "beam, %s lenses: angles %s deg (sigma %.2f), distances %s %% (sigma %.1f), between each other %s %%, focal %s",
        lenses, angles_deg.round(2), told["angle_sigma_deg"], (100 * distances).round(1),
        told["distance_sigma_percent"], (100 * ratios).round(1), told["focal_px"],
    )  # fmt: skip
    assert angles_deg.max() < 3.0 * told["angle_sigma_deg"]
    assert np.abs(distances).max() < 3.0 * 0.01 * told["distance_sigma_percent"]
    assert told["verdict"] != "good"
    assert any("the recording shows 2 s of motion: 20 s or more are better" in each for each in told["advice"])
