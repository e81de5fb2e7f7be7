"""Marker files as other programs and people write them, through the commands: solved as the plain file, or told."""

import json
import zipfile
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_keypoints import simulate_keypoints
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.from_motion import frames_of

FPS, FRAMES = 30.0, 40
FEET = ["lfoot", "rfoot", "ltoes", "rtoes"]
AXES = {"x": [1, 2, 0], "y": [0, 1, 2], "z": [2, 0, 1]}  # the world's axes that a file of this up axis has, in order
KEPT = np.random.default_rng(1).random(FRAMES) > 0.3
KEPT[[0, 1, -1]] = True
LOST = {"kept": KEPT, "numbers": np.arange(1, FRAMES + 1)[KEPT]}


@dataclass(frozen=True)
class Trc:
    """How a TRC file is written."""

    up: str = "z"
    signs: tuple[int, int, int] = (1, 1, 1)
    per_m: float = 1000.0
    unit: str = "mm"
    rate: float = FPS
    second: float = 1.0  # in the file's unit of time
    rename: Any = str
    more: tuple[str, ...] = ()  # names of further columns
    kept: Any = None  # mask of the frames that are written, None for all
    numbers: Any = None
    times_s: Any = None
    missing: str = ""
    text: Any = str  # changes the whole text
    encoding: str = "utf-8"
    changed: Any = np.copy

    def _frames(self, take):
        return np.arange(take.frames) if self.kept is None else np.flatnonzero(self.kept)

    def write(self, take, path):
        """Write a take with y up."""
        points = self.changed(take.positions_m)[..., AXES[self.up]] * self.signs * self.per_m
        points = np.concatenate((points, points[:, : len(self.more)] + 0.2 * self.per_m), axis=1)[self._frames(take)]
        names = [*map(self.rename, take.names), *self.more]
        times_s = self._frames(take) / FPS if self.times_s is None else self.times_s
        numbers = np.arange(1, len(points) + 1) if self.numbers is None else self.numbers
        facts = (
            f"{self.rate:g}\t{self.rate:g}\t{len(points)}\t{len(names)}\t{self.unit}\t{self.rate:g}\t1\t{len(points)}"
        )
        lines = [
            "PathFileType\t4\t(X/Y/Z)\ta.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
            facts,
            "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
            "\t\t" + "\t".join(f"{axis}{n + 1}" for n in range(len(names)) for axis in "XYZ"),
            "",
        ]
        for number, time_s, row in zip(numbers, times_s, points, strict=True):
            values = [f"{value:.6f}" if np.isfinite(value) else self.missing for value in row.ravel()]
            lines.append("\t".join([str(number), f"{self.second * time_s:.6f}", *values]))
        path.write_bytes(self.text("\n".join(lines) + "\n").encode(self.encoding))


def gaps(positions_m):
    changed = positions_m.copy()
    changed[10:13, 1] = changed[20:22, 4] = np.nan
    return changed


SAME = {
    "z up": Trc(),
    "x up": Trc("x"),
    "y up": Trc("y"),
    "z down": Trc(signs=(1, -1, -1)),
    "y down": Trc("y", (-1, -1, 1)),
    "metres": Trc(per_m=1.0, unit="m"),
    "centimetres": Trc(per_m=100.0, unit="cm"),
    "inches": Trc(per_m=1.0 / 0.0254, unit="inch"),
    "feet": Trc(per_m=1.0 / 0.3048, unit="ft"),
    "milliseconds": Trc(second=1000.0),
    "header of another rate": Trc(rate=120.0),
    "frames lost": Trc(**LOST),
    "frames lost, numbered on": Trc(kept=KEPT),
    "doubled tabs": Trc(text=lambda text: text.replace("\t", "\t\t")),
    "tabs at the end": Trc(text=lambda text: text.replace("\n", "\t\t\n")),
    "decimal commas": Trc(text=lambda text: text.replace(".", ",").replace("a,trc", "a.trc")),
    "carriage returns": Trc(text=lambda text: text.replace("\n", "\r")),
    "UTF-16": Trc(encoding="utf-16"),
    "subject before the labels": Trc(rename="Anna: {}".format),
    "lower case": Trc(rename=str.lower),
    "spaces": Trc(rename=lambda name: f" {name[:1]} {name[1:]} "),
    "markers without labels": Trc(more=("*1", "*2", "*3")),
    "a column without a name": Trc(more=("",)),
    "missing as blanks": Trc(changed=gaps),
    "missing as zeros": Trc(changed=gaps, missing="0.0"),
    "missing as NaN": Trc(changed=gaps, missing="NaN"),
}
REFUSED = {
    "millimetres called metres": (
        Trc(unit="m"),
        "km tall (the numbers seem to be millimetres, the file calls them metres)",
    ),
    "metres called millimetres": (Trc(per_m=1.0), "mm tall (the numbers seem to be metres, the file calls them milli"),
    "inches called millimetres": (Trc(per_m=1.0 / 0.0254), "(the numbers seem to be inches, the file calls them milli"),
    "millimetres called inches": (Trc(unit="in"), "(the numbers seem to be millimetres, the file calls them inches)"),
}


def other_side(name):
    return {"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:]


TOLD = {
    "mirrored": (Trc(signs=(-1, 1, 1)), "verdict", "mm from its markers"),
    "sides exchanged throughout": (Trc(rename=other_side), "verdict", "mm from its markers"),
    "header of another rate": (
        Trc(rate=120.0),
        "warnings",
        "the header says 120 frames per second, but the times give 30",
    ),
    "frames lost": (Trc(**LOST), "warnings", "frames are missing"),
    "numbers against times": (
        Trc(**LOST, times_s=np.arange(KEPT.sum()) / FPS), "warnings",
        "skip 10 frames, the times none: the times are used"
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def take(truth, subject):
    take, _ = simulate_markers(truth, subject)
    return replace(take, positions_m=take.positions_m[:FRAMES], frame_numbers=np.arange(FRAMES), times_s=np.empty(0))


@pytest.fixture(scope="module")
def solved(take, truth, database_file, tmp_path_factory):
    """Return a function that solves a file of the take: exit status, JSON, errors, motion or None."""
    folder = tmp_path_factory.mktemp("foreign")
    write_bvh(truth, folder / "walker.bvh")

    def solve(written, capsys, *method):
        written.write(take, folder / "a.trc")
        (folder / "out.bvh").unlink(missing_ok=True)
        body = [
            "--skeleton",
            str(folder / "walker.bvh"),
            "--marker-set",
            "locomotion",
            "--method",
            "nearest",
            "--causal",
        ]
        line = ["solve", str(folder / "a.trc"), *body, "--database", str(database_file)]
        status = main([*line, "--out", str(folder / "out.bvh"), "--json"])
        printed = capsys.readouterr()
        motion = read_motion(folder / "out.bvh") if (folder / "out.bvh").exists() else None
        return status, json.loads(printed.out) if printed.out else {}, printed.err, motion

    return solve


@pytest.fixture(scope="module")
def kept():
    """What is solved once for all."""
    return {}


@pytest.fixture
def plain(solved, capsys, kept):
    """Return a function that solves the file that another program writes by default, once by each method."""

    def solve(*method):
        if method not in kept:
            kept[method] = solved(Trc(), capsys, *method)
        return kept[method]

    return solve


@pytest.mark.parametrize("case", SAME)
def test_the_motion_is_that_of_the_plain_file(case, solved, plain, capsys):
    status, _, error, motion = solved(SAME[case], capsys)
    usual = plain()[3]
    assert (status, error) == (0, "")
    assert motion.duration_s == pytest.approx(usual.duration_s, abs=0.5 / FPS)
    assert evaluate(motion, usual)["bone_direction_in_root_deg"] < 3.0
    heights_m = [each.root_positions_m[:, 1].mean() for each in (motion, usual)]
    assert heights_m[0] == pytest.approx(heights_m[1], abs=0.01)


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_unit_is_refused_with_the_right_one(case, solved, capsys):
    written, said = REFUSED[case]
    status, _, error, motion = solved(written, capsys)
    assert (status, motion, error.count("\n")) == (1, None, 1)
    assert said in error


@pytest.mark.parametrize("case", TOLD)
def test_what_cannot_be_right_is_told(case, solved, plain, capsys):
    written, key, said = TOLD[case]
    status, told, _, _ = solved(written, capsys, "--method", "best")
    assert status == 0 and said in str(told[key])
    assert plain("--method", "best")[1]["verdict"] == "good"


@pytest.mark.long
def test_a_body_is_fitted_to_a_take_that_begins_empty(take, database_file, tmp_path, capsys):
    shown_m = np.concatenate((np.full((305, len(take.names), 3), np.nan), take.positions_m[:24]))
    late = replace(take, positions_m=shown_m, frame_numbers=np.empty(0, int), times_s=np.empty(0))
    Trc().write(late, tmp_path / "late.trc")
    line = [
        "calibrate",
        "subject",
        str(tmp_path / "late.trc"),
        "--marker-set",
        "auto",
        "--database",
        str(database_file),
    ]
    assert main([*line, "--out", str(tmp_path / "a.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["residual_mm"] < 15.0


@pytest.mark.long
@pytest.mark.parametrize(("name", "ending"), [("halpe-26", "npy"), ("halpe-26", "trc")])
def test_keypoints_become_motion_by_one_command(truth, database_file, tmp_path, capsys, name, ending):
    part = sliced(truth, 0, FRAMES)
    take, file = simulate_keypoints(part, load_marker_set(name), seed=3), tmp_path / f"points.{ending}"
    if ending == "npy":
        np.save(file, 1000.0 * take.positions_m[..., AXES["z"]])
    else:
        Trc(per_m=1.0, unit="m").write(take, file)
    line = ["solve", str(file), "--database", str(database_file), "--out", str(tmp_path / "a.bvh"), "--json"]
    assert main(line) == 0
    told, motion = json.loads(capsys.readouterr().out), read_motion(tmp_path / "a.bvh")
    assert (told["verdict"], told["marker_set"], motion.frames) == ("good", name, FRAMES)
    joints_m, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    head, feet = (joints_m[:, [motion.skeleton.index(each) for each in names], 1] for names in (["head"], FEET))
    assert 1.2 < np.median(head) < 1.8 and abs(np.median(feet.min(axis=1))) < 0.1
    jitter_m = [np.linalg.norm(np.diff(each, 3, axis=0), axis=-1).mean() for each in (joints_m, take.positions_m)]
    assert jitter_m[0] < jitter_m[1] / 3.0


def test_an_archive_in_an_archive_is_named(tmp_path, capsys):
    for name, inner in (("inner.zip", "a.bvh"), ("outer.zip", "inner.zip")):
        (tmp_path / "a.bvh").write_text("HIERARCHY\n")
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.write(tmp_path / inner, inner)
    assert main(["database", "build", str(tmp_path / "outer.zip"), "--out", str(tmp_path / "a.pfdb")]) == 1
    assert "inner.zip: is an archive inside an archive; unpack it" in capsys.readouterr().err


def test_a_file_alone_becomes_a_take_that_tells_why(take, database_file, tmp_path, capsys, monkeypatch):
    """With the starter database, and no body named."""
    monkeypatch.setattr("perfanim.core.cli.solve_command.starter_database", lambda progress: database_file)
    Trc().write(frames_of(take, slice(0, 24)), tmp_path / "a.trc")
    assert main(["take", "info", "--why", str(tmp_path / "a.trc")]) == 1
    assert f"perfanim solve {tmp_path / 'a.trc'} --out {tmp_path / 'a.perftake'}" in capsys.readouterr().err
    assert main(["solve", str(tmp_path / "a.trc"), "--out", str(tmp_path / "a.perftake"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "good"
    assert main(["take", "info", "--why", str(tmp_path / "a.perftake"), "--json"]) == 0
    assert isinstance(json.loads(capsys.readouterr().out)["decisions"], list)
    assert main(["take", "export", str(tmp_path / "a.perftake"), "--out", str(tmp_path / "a.bvh")]) == 0
