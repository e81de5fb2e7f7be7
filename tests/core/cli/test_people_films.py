"""Films of a person by the command line, with a replaced network: not started together, or of no use."""

import json

import cv2
import numpy as np
import pytest
from filmed_people import POINTS, keypoints, one_network, write_film
from perfanim.core.api import tracking
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.network_file import NETWORK_FILE, body_network_file
from perfanim.core.vision.people.people_pipeline import APART

RIG = default_rig()
LATE = 15  # pictures that the left film shows before the right one begins


COUNT = 120
WHOLE, LATER = [10 * n for n in range(COUNT)], [10 * n + 1 for n in range(LATE, COUNT)]

SHORT = WHOLE[:30], [10 * n + 1 for n in range(30)]


@pytest.fixture(scope="module")
def points_m(boxing):
    return keypoints(boxing)[:COUNT]


@pytest.fixture
def network(monkeypatch, points_m):
    """The network that finds the person, in place of BlazePose."""
    found = one_network(RIG, points_m)

    class Replaced:
        marker_set = POINTS.name

        def __new__(cls, _path):
            return found

    monkeypatch.setattr(tracking, "BlazePose", Replaced)
    return found


@pytest.fixture
def track(network, tmp_path, capsys):
    """track(left pictures, right pictures) -> exit status and what was said, as JSON if it succeeded."""

    def run(left, right, out="a.take.npz", right_fps=30.0):
        save_rig(RIG, tmp_path / "cameras.toml")
        films = [write_film(tmp_path / "left.avi", left), write_film(tmp_path / "right.avi", right, right_fps)]
        line = ["track", "--cameras", tmp_path / "cameras.toml", "--left", films[0], "--right", films[1]]
        status = main([*map(str, line), "--people", "network", "--json", "--out", str(tmp_path / out)])
        said = capsys.readouterr()
        return status, json.loads(said.out) if status == 0 else said.err

    return run


def test_films_that_were_not_started_together_are_synchronised(track, tmp_path, points_m):
    status, told = track(WHOLE, LATER)
    assert status == 0 and told["time_offsets_applied"]
    assert told["time_offsets_ms"][1] == pytest.approx(1e3 * LATE / 30.0, abs=5.0)
    take = read_take(tmp_path / "a.take.npz")
    away_m = np.linalg.norm(take.positions_m - points_m[COUNT - len(take.positions_m) :], axis=-1)
    assert len(take.positions_m) >= len(LATER) - 1 and np.median(away_m) < 0.005


def test_films_of_different_rates_are_synchronised(track, tmp_path, points_m):
    """The right film has every other picture."""
    status, told = track(WHOLE, LATER[::2], right_fps=15.0)
    assert status == 0
    assert told["time_offsets_ms"][1] == pytest.approx(1e3 * LATE / 30.0, abs=5.0)
    take = read_take(tmp_path / "a.take.npz")
    assert take.fps == pytest.approx(15.0)
    away_m = np.linalg.norm(take.positions_m - points_m[LATE::2][: len(take.positions_m)], axis=-1)
    assert len(take.positions_m) >= len(LATER) // 2 - 1 and np.median(away_m) < 0.01


def test_a_recorded_take_of_such_films_has_their_common_part(track, tmp_path):
    status, told = track(WHOLE, LATER, out="a.perftake")
    assert status == 0 and len(LATER) - 1 <= told["frames"] <= len(LATER)


def test_films_of_different_motion_are_told_and_leave_nothing(track, tmp_path):
    status, said = track(WHOLE, [1] * len(LATER))
    assert status == 1
    assert "when right began to film cannot be told from the motion that left shows; give films of the same" in said
    assert not (tmp_path / "a.take.npz").exists()


@pytest.mark.parametrize("content", [b"TFL3 cut off", b"\x1c\x00\x00\x00TFL3" + bytes(10_000)])
def test_a_damaged_network_or_another_one_is_told(tmp_path, capsys, content):
    (tmp_path / NETWORK_FILE).write_bytes(content)
    save_rig(RIG, tmp_path / "cameras.toml")
    films = [write_film(tmp_path / f"{side}.avi", [0, 1, 2]) for side in ("left", "right")]
    line = ["track", "--cameras", tmp_path / "cameras.toml", "--left", films[0], "--right", films[1]]
    line += ["--people", tmp_path / NETWORK_FILE, "--out", tmp_path / "a.take.npz"]
    assert main(list(map(str, line))) == 1
    assert f"is damaged, or not the {NETWORK_FILE} that this version knows; get the" in capsys.readouterr().err
    assert not (tmp_path / "a.take.npz").exists()


def test_films_of_nobody_are_told_and_leave_nothing(track, tmp_path):
    status, said = track(range(5000, 5020), range(6000, 6020))
    assert status == 1 and "nobody was found in the images of left and right; check the light" in said
    assert not (tmp_path / "a.take.npz").exists()


def test_a_camera_that_shows_nobody_is_named(track, tmp_path):
    status, said = track(SHORT[0], range(6000, 6000 + len(SHORT[0])))
    assert status == 1 and "nobody was found in the images of right; check the light" in said
    assert not (tmp_path / "a.take.npz").exists()


def test_a_camera_that_loses_the_person_is_told_and_the_other_s_points_are_kept(track, tmp_path):
    status, told = track(SHORT[0], [*SHORT[1][:20], *range(6000, 6010)])
    assert status == 0 and "the right camera shows nobody" in told["warnings"]
    take = read_take(tmp_path / "a.take.npz")
    assert np.all(take.single.cameras[20:] == 0) and np.isfinite(take.single.points[20:]).all()


def test_a_cut_to_another_room_is_told_and_the_rest_is_kept(track, network, tmp_path, points_m):
    """From the eleventh picture on, the right film shows somebody elsewhere."""
    for number in SHORT[1][10:]:
        network.pixels[number] = 0.7 * network.pixels[number] + (150.0, 90.0)
    status, told = track(*SHORT)
    assert status == 0 and APART in told["warnings"]
    take = read_take(tmp_path / "a.take.npz")
    np.testing.assert_allclose(take.positions_m[:10], points_m[:10], atol=1e-4)


def test_a_frozen_camera_is_told_and_left_out(track, tmp_path, points_m):
    status, told = track(SHORT[0], [*SHORT[1][:10], *[SHORT[1][9]] * 8, *SHORT[1][18:]])
    assert status == 0 and "right.avi shows 8 frames twice: repeats were left out" in told["warnings"]
    take = read_take(tmp_path / "a.take.npz")
    located = np.isfinite(take.positions_m[..., 0]).all(axis=1)
    assert not located[10:18].any() and located[:10].all() and located[18:].all()
    np.testing.assert_allclose(take.positions_m[located], points_m[: len(located)][located], atol=1e-4)


def test_of_two_persons_one_is_followed(track, network, tmp_path, points_m):
    """Somebody else stands 1.2 m farther to the side."""
    other = one_network(RIG, points_m + np.array([1.2, 0.0, 0.0]))
    alone = network.find
    network.find = lambda *asked: max(alone(*asked), other.find(*asked), key=lambda found: found.score)
    status, told = track(*SHORT)
    assert status == 0 and told["warnings"] == []
    take = read_take(tmp_path / "a.take.npz")
    away_m = take.positions_m - points_m[: len(take.positions_m)]
    np.testing.assert_allclose(away_m, np.broadcast_to(np.median(away_m, axis=(0, 1)), away_m.shape), atol=1e-4)


def test_a_dog_whom_the_network_takes_for_a_person_is_told(tmp_path, capsys):
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    save_rig(RIG, tmp_path / "cameras.toml")
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for number in range(2):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), dog())
    line = ["track", "--cameras", tmp_path / "cameras.toml", "--left", tmp_path / "left", "--right", tmp_path / "right"]
    assert main([*map(str, line), "--people", "--json", "--out", str(tmp_path / "a.take.npz")]) == 0
    (told,) = [each for each in json.loads(capsys.readouterr().out)["warnings"] if "shape" in each]
    assert (
        told == "what the network found does not have the shape of a person: it also finds people in animals and things"
    )


def dog():
    """Return a picture of a dog on a lawn."""
    image = np.full((480, 640, 3), (90, 160, 110), dtype=np.uint8)
    image[:220] = (220, 200, 180)
    brown = (40, 80, 130)
    cv2.ellipse(image, (320, 290), (120, 55), 0, 0, 360, brown, -1)
    for x in (225, 255, 385, 415):
        cv2.rectangle(image, (x - 10, 300), (x + 10, 420), brown, -1)
    cv2.ellipse(image, (455, 220), (48, 38), 20, 0, 360, brown, -1)
    cv2.ellipse(image, (500, 235), (30, 17), 10, 0, 360, (30, 60, 100), -1)
    cv2.ellipse(image, (425, 205), (14, 40), 25, 0, 360, (25, 50, 90), -1)
    cv2.circle(image, (465, 208), 5, (0, 0, 0), -1)
    cv2.line(image, (205, 270), (150, 200), brown, 14)
    return image
