"""Films of a person by the command line, with a replaced network: not started together, or of no use."""

import json

import numpy as np
import pytest
from filmed_people import POINTS, keypoints, one_network, write_film
from perfanim.core.api import tracking
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.simulate.studio.studio_rig import default_rig

RIG = default_rig()
LATE = 15  # pictures that the left film shows before the right one begins


COUNT = 120
WHOLE, LATER = [10 * n for n in range(COUNT)], [10 * n + 1 for n in range(LATE, COUNT)]


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
    assert told["time_offsets_ms"][1] == pytest.approx(1e3 * LATE / 30.0, abs=2.0)
    take = read_take(tmp_path / "a.take.npz")
    away_m = np.linalg.norm(take.positions_m - points_m[LATE : LATE + len(take.positions_m)], axis=-1)
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
