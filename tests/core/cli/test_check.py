"""`perfanim check`: from films and pictures to advice."""

import json

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.simulate.faults import studio_with
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.rig import default_rig
from perfanim.core.simulate.studio.video import LOSSLESS, open_video
from perfanim.core.subjects.setup_check.finding import Fault


def write_film(path, images):
    with open_video(path, 30.0, (640, 480), LOSSLESS[1]) as video:
        for image in images:
            video.write(image)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Films of a studio whose room is much too bright, and its calibration."""
    folder = tmp_path_factory.mktemp("check")
    studio = studio_with(Fault.BRIGHT, np.random.default_rng(4))
    for index, side in enumerate(("left", "right")):
        write_film(folder / f"empty-{side}.mkv", [images[index] for images in studio.empty])
        write_film(folder / f"{side}.mkv", [moment.images[index] for moment in studio.moments[:12]])
    save_rig(studio.rig, folder / "cameras.toml")
    return folder


def check_cameras(folder, *more):
    films = [str(folder / f"{name}.mkv") for name in ("left", "right", "empty-left", "empty-right")]
    options = ["--cameras", str(folder / "cameras.toml"), "--left", films[0], "--right", films[1]]
    return main(["check", "cameras", *options, "--background", *films[2:], *more])


def test_a_fault_is_named_with_advice(folder, capsys):
    assert check_cameras(folder, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "mend first"
    assert {finding["fault"] for finding in told["findings"]} == {"too bright"}
    assert all("shorter exposure" in finding["advice"] for finding in told["findings"])
    assert told["space"].startswith("you may walk ")


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--marker-set", "nonsense"], "there is no marker set or file 'nonsense'"),
        (["--height", "17"], "--height 17 is out of range"),
        (["--cameras", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_bad_input_is_one_line(folder, capsys, more, text):
    assert check_cameras(folder, *more) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert text in lines[0]


def test_a_board_of_good_size(tmp_path, capsys):
    renderer = Renderer(default_rig())
    for picture in board_pictures(renderer, DEFAULT_BOARD, 3):
        for side, image in zip(("left", "right"), picture.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{picture.number}.png"), image)
    arguments = ["--left", str(tmp_path / "left"), "--right", str(tmp_path / "right"), "--board", "chessboard:9x6:80mm"]
    assert main(["check", "board", *arguments, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "good"
    assert told["views"] == {"the left camera": 3, "the right camera": 3}
