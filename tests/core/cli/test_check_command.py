"""`perfanim check`: from films and pictures to advice."""

import json

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.simulate import practice_studio
from perfanim.core.simulate.practice_studio import studio_with
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.video import LOSSLESS, open_video
from perfanim.core.subjects.setup_check.finding import Fault


def write_film(path, images, fps=30.0):
    with open_video(path, fps, (640, 480), LOSSLESS[1]) as write:
        for image in images:
            write(image)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Films of a studio whose room is much too bright, and its calibration."""
    folder = tmp_path_factory.mktemp("check")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(practice_studio, "SECONDS", 0.4)
        studio = studio_with(Fault.BRIGHT, np.random.default_rng(4))
    for index, side in enumerate(("left", "right")):
        write_film(folder / f"empty-{side}.mkv", [images[index] for images in studio.empty])
        write_film(folder / f"{side}.mkv", [moment.images[index] for moment in studio.moments])
    save_rig(studio.rig, folder / "cameras.toml")
    return folder


def check_cameras(folder, *more):
    films = [str(folder / f"{name}.mkv") for name in ("left", "right", "empty-left", "empty-right")]
    options = ["--cameras", str(folder / "cameras.toml"), "--left", films[0], "--right", films[1]]
    return main(["check", "cameras", *options, "--background", *films[2:], *more])


def test_a_fault_is_named_with_advice(folder, capsys):
    before = (folder / "cameras.toml").read_bytes()
    assert check_cameras(folder, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "fix first"
    assert {finding["fault"] for finding in told["findings"]} == {"too bright"}
    assert all("shorter exposure" in finding["advice"] for finding in told["findings"])
    assert told["space"].startswith("you may walk ")
    assert (folder / "cameras.toml").read_bytes() == before  # only --ignore notes what is found


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


@pytest.mark.long
def test_reflections_are_noted_in_the_calibration_and_forgotten_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(practice_studio, "FPS", 15.0)  # half the pictures
    studio = studio_with(Fault.REFLECTION, np.random.default_rng(18))
    for index, side in enumerate(("left", "right")):
        write_film(tmp_path / f"empty-{side}.mkv", [images[index] for images in studio.empty], 15.0)
        write_film(tmp_path / f"{side}.mkv", [moment.images[index] for moment in studio.moments], 15.0)
    save_rig(studio.rig, tmp_path / "cameras.toml")

    def told(*more):
        assert check_cameras(tmp_path, "--json", "--marker-set", studio.marker_set.name, *more) == 0
        return json.loads(capsys.readouterr().out)

    told("--ignore", "reflections")
    noted, later = load_rig(tmp_path / "cameras.toml").ignored, told()
    assert len(noted) == later["ignored_places"] > 0
    assert later["verdict"] == "good"
    films = [str(tmp_path / f"{name}.mkv") for name in ("left", "right", "empty-left", "empty-right")]
    out = str(tmp_path / "walk.perftake")
    options = ["--cameras", str(tmp_path / "cameras.toml"), "--left", films[0], "--right", films[1], "--out", out]
    assert main(["track", *options, "--json", "--seconds", "4", "--background", *films[2:]]) == 0
    capsys.readouterr()
    seen = [blobs[:, :2] for frame in read_take_file(out).frames for blobs in frame.blobs]
    camera, *place = noted[0]
    assert len(seen) > 100
    assert all(np.linalg.norm(pixels - place, axis=1).min(initial=99.0) > 5.0 for pixels in seen[int(camera) :: 2])
    forgotten = told("--ignore", "none")
    assert {finding["fault"] for finding in forgotten["findings"]} == {"reflection"}
    assert forgotten["ignored_places"] == 0
    assert len(load_rig(tmp_path / "cameras.toml").ignored) == 0


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
