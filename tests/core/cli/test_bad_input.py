"""Bad input of every kind: exit 1, one line that says what is wrong, nothing left behind."""

import re
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, save_take
from perfanim.core.markers.subject import save_subject, subject_tables
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.system.files import write_toml
from perfanim.core.system.schema import table_of

SIZE = (64, 48)
LONG = "x" * 300
MATRIX = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])


def write_video(path, frames: int, size=SIZE):
    """A black video."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, size)
    for _ in range(frames):
        writer.write(np.zeros((size[1], size[0], 3), dtype=np.uint8))
    writer.release()


def write_pictures(folder, numbers, size=SIZE):
    """Black pictures with a number each."""
    folder.mkdir()
    for number in numbers:
        cv2.imwrite(str(folder / f"{number:03d}.png"), np.zeros((size[1], size[0], 3), dtype=np.uint8))


def save_enlarged(folder, subject):
    """A subject with bones a million times too long, and one with such offsets of markers."""
    tables = subject_tables(subject)
    joints = [row | {"offset_m": (1e6 * np.array(row["offset_m"])).tolist()} for row in tables["joint"]]
    write_toml(folder / "giant.toml", tables | {"joint": joints})
    markers = [row | {"offset_m": (1e6 * np.array(row["offset_m"])).tolist()} for row in tables["marker_set"]["marker"]]
    write_toml(folder / "far.toml", tables | {"marker_set": tables["marker_set"] | {"marker": markers}})


@pytest.fixture(scope="module")
def files(tmp_path_factory, truth, subject, database_file):
    """Good files and bad ones of every kind."""
    folder = tmp_path_factory.mktemp("files")
    take = simulate_markers(truth, subject)[0]
    save_take(take, folder / "walk.take.npz")
    (folder / "cut.take.npz").write_bytes((folder / "walk.take.npz").read_bytes()[:900])
    save_take(replace(take, positions_m=np.full_like(take.positions_m, np.nan)), folder / "unseen.take.npz")
    save_take(MarkerTake("hand", 60.0, ("LHAN", "RHAN"), np.zeros((9, 2, 3))), folder / "hands.take.npz")
    save_subject(subject, folder / "walker.toml")
    save_enlarged(folder, subject)
    (folder / "walk.db").write_bytes(database_file.read_bytes())
    (folder / "half.db").write_bytes(database_file.read_bytes()[: database_file.stat().st_size // 2])
    (folder / "words.txt").write_text("no motion here\n")
    for ending in ("bvh", "amc", "asf", "trc", "c3d", "csv", "take.npz", "toml", "db", "avi", "json"):
        (folder / f"words.{ending}").write_text("no motion here\n")
    (folder / "empty").mkdir()
    shifted = (
        Camera(n, SIZE, MATRIX, np.zeros(5), np.diag([1.0, -1, -1]), np.array([x, 0, 0]))
        for n, x in (("l", 0), ("r", -1))
    )
    save_rig(CameraRig(tuple(shifted)), folder / "cameras.toml")
    write_video(folder / "long.avi", 20)
    write_video(folder / "long2.avi", 20)
    write_video(folder / "short.avi", 14)
    write_video(folder / "large.avi", 20, (128, 96))
    write_pictures(folder / "left", range(6))
    write_pictures(folder / "right", range(6))
    write_pictures(folder / "other", range(50, 54))
    write_pictures(folder / "large", range(6), (128, 96))
    write_pictures(folder / "torn", range(6))
    (folder / "torn" / "003.png").write_bytes((folder / "left" / "003.png").read_bytes()[:40])
    table = table_of(load_marker_set("locomotion"))
    write_toml(folder / "two-torso.toml", table | {"marker": [row | {"torso": False} for row in table["marker"]]})
    return folder


SOLVE = "solve walk.take.npz --database walk.db --subject walker.toml --out out/a.bvh"
TRACK = "track --cameras cameras.toml --left left --right right --out out/a.take.npz"
SUBJECT = "calibrate subject walk.take.npz --marker-set locomotion --out out/a.toml"
BUILD = "database build empty --out out/a.db"

CASES = [
    # solve
    (SOLVE.replace("walk.take.npz", "gone.take.npz"), "gone.take.npz: cannot be read"),
    (SOLVE.replace("walk.take.npz", "words.take.npz"), "words.take.npz: is not a marker take"),
    (SOLVE.replace("walk.take.npz", "words.c3d"), "words.c3d: is not a C3D file"),
    (SOLVE.replace("walk.take.npz", "words.trc"), "words.trc: is not a TRC file"),
    (SOLVE.replace("walk.take.npz", "words.txt"), "words.txt: is not a marker take"),
    (SOLVE.replace("walk.take.npz", "cut.take.npz"), "cut.take.npz: .*check the file"),
    (SOLVE.replace("walk.take.npz", "walk.db"), "walk.db: .*give one of .c3d"),
    (
        SOLVE.replace("walk.take.npz", "hands.take.npz"),
        "fewer than three of the torso markers.*; choose the marker set",
    ),
    (SOLVE + " --marker-set two-webcams", "those of the set two-webcams are called Center1, Center2"),
    (SOLVE + " --marker-set gone", "there is no marker set or file 'gone'; shipped sets: .*boxing"),
    (SOLVE + " --marker-set two-torso.toml", "at least 3 markers with torso = true"),
    (SOLVE.replace("walk.db", "gone.db"), "gone.db: cannot be read .*check the path"),
    (SOLVE.replace("walk.db", "half.db"), "half.db: is cut off.*build it again"),
    (SOLVE.replace("walk.db", "half.db") + " --json", "half.db: is cut off"),
    (SOLVE.replace("walk.db", "words.db"), "words.db: is not a motion database"),
    (SOLVE.replace("walk.db", "empty"), "empty: cannot be read"),
    (SOLVE.replace("walker.toml", "cameras.toml"), "cameras.toml: is not a subject file"),
    (SOLVE.replace("walker.toml", "words.toml"), "words.toml: is not valid TOML"),
    (SOLVE.replace("--subject walker.toml", "--skeleton words.asf --marker-set boxing"), "words.asf: is not an ASF"),
    (SOLVE + " --smooth 99", "a cut-off frequency of 99 Hz for smoothing is out of range"),
    (SOLVE.replace("out/a.bvh", "empty"), "empty: does not have the extension of a motion file"),
    (SOLVE.replace("out/a.bvh", "words.txt/a.bvh"), "words.txt/a.bvh: cannot be written"),
    # calibrate subject
    (SUBJECT.replace("locomotion", "kendo"), "the take has no marker"),
    (SUBJECT + " --frames 50:20", "selects no frames; choose from 0:60"),
    (SUBJECT + " --frames ten", "'ten' is not A:B"),
    (SUBJECT + " --seconds -1", "--seconds -1 is out of range"),
    (SUBJECT + " --seconds nan", "--seconds nan"),
    (SUBJECT.replace("locomotion", "dancing"), "there is no marker set or file 'dancing'"),
    (SUBJECT + " --database half.db", "half.db: is cut off"),
    (SUBJECT + " --database walk.db --height 9", "--height 9 is out of range"),
    (SUBJECT.replace("walk.take.npz", "unseen.take.npz"), "fewer than three"),
    # track
    (TRACK.replace("cameras.toml", "words.toml"), "words.toml: is not valid TOML"),
    (TRACK.replace("cameras.toml", "walker.toml"), r"walker.toml: holds no cameras; use a calibration from"),
    (TRACK.replace("--right right", "--right gone"), "gone: not found"),
    (TRACK.replace("--right right", "--right empty"), "empty: contains no image files"),
    (TRACK.replace("--right right", "--right left"), "two cameras are given the same source"),
    (TRACK.replace("--right right", "--right other"), "6 and 4 pictures and no numbers in common"),
    (TRACK.replace("--right right", "--right torn"), "003.png: is not a readable image"),
    (TRACK.replace("--right right", "--right long.avi"), "sources are of different kinds"),
    (TRACK, "almost no markers|no markers"),
    (TRACK + " --marker-set locomotion", "almost no markers|no markers|at most 0"),
    (
        TRACK.replace("--left left --right right", "--left long.avi --right short.avi"),
        "long.avi 20 frames, short.avi 14",
    ),
    (
        TRACK.replace("--left left --right right", "--left long.avi --right large.avi"),
        "128x96, but the calibration is for 64x48",
    ),
    (TRACK.replace("a.take.npz", "a.doc"), "a.doc: does not have an extension that can be written"),
    (TRACK + " --seconds 0", "--seconds must be a number above 0 s up to 86,400 s"),
    (TRACK + " --marker-set gone", "there is no marker set or file 'gone'"),
    (TRACK + " --markers 0", "--markers must be a whole number from 1 to 200"),
    (TRACK + " --threshold 900", "threshold"),
    (TRACK.replace("cameras.toml", "gone.toml"), "gone.toml: cannot be read"),
    (TRACK.replace("--right right", "--right large"), "images are 128x96, but the calibration is for 64x48"),
    (TRACK + " --fps -3", "--fps must be a number from 1 to 1,000 frames per second"),
    (TRACK + " --floor feet", "--floor feet needs --marker-set"),
    (TRACK + " --floor-cameras out/level.toml", "--floor-cameras needs --floor feet"),
    # database
    (BUILD, "empty: found no usable motion"),
    (BUILD.replace("empty", "gone"), "gone: does not exist"),
    (BUILD + " --fps nan", "--fps nan is out of range"),
    (BUILD.replace("empty", "words.bvh"), "words.bvh: is not a BVH file"),
    (BUILD.replace("empty", "words.txt"), "neither motion nor an archive"),
    ("database info half.db", "half.db: is cut off"),
    ("database info empty", "empty: cannot be read"),
    # a unit of length mistaken
    (
        SOLVE.replace("walker", "giant"),
        "giant.toml, .*: offset_m must be three numbers from -10 to 10 m; calibrate the subject again",
    ),
    (
        SOLVE.replace("walker", "far"),
        "far.toml, locomotion, LSHO: offset_m must be three numbers from -10 to 10 m; calibrate",
    ),
    # calibrate cameras
    ("calibrate cameras --points words.json --out out/a.toml", "words.json: does not contain board points"),
    ("calibrate cameras --points gone.json --out out/a.toml", "gone.json: cannot be read"),
    ("calibrate cameras --left left --right right --board 9x6 --out out/a.toml", "does not describe a board"),
    ("calibrate cameras --left left --right right --board chessboard:9x6:0 --out out/a.toml", "larger than zero"),
    ("calibrate cameras --left left --right right --out out/a.toml", "--board is missing"),
    ("calibrate cameras --board chessboard:9x6:25mm --out out/a.toml", "pictures of each camera are needed"),
    ("calibrate cameras --left left --right right --board chessboard:9x6:25mm --out out/a.toml", "found in 0 of 6"),
    ("calibrate cameras --left left --board chessboard:9x6:25mm --out out/a.toml", "--left and --right go together"),
    (
        f"calibrate cameras --left {LONG} --right left --board chessboard:9x6:25mm --out out/a.toml",
        "no image files found",
    ),
    # names that no file can have
    (f"take recover {LONG}.perftake", "cannot be read .File name too long"),
    # simulate, evaluate
    ("simulate markers words.bvh --marker-set boxing --out out/a.take.npz", "words.bvh: is not a BVH file"),
    (
        "simulate markers words.bvh --marker-set boxing --out out/a.doc",
        "a.doc: does not have an extension that can be written",
    ),
    *(
        (f"simulate markers words.bvh --marker-set boxing --out out/a.csv --fps={fps}", "out of range")
        for fps in ("0", "nan", "-5")
    ),
    ("simulate cameras words.bvh --out out/studio", "words.bvh: is not a BVH file"),
    ("evaluate words.bvh --truth words.bvh", "words.bvh: is not a BVH file"),
]


@pytest.mark.parametrize(
    ("line", "message"), CASES, ids=[f"{line.split()[0]}-{i}" for i, (line, _) in enumerate(CASES)]
)
def test_one_line_says_what_is_wrong_and_nothing_is_left(line, message, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    before = sorted(files.rglob("*"))
    assert main(line.split()) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("perfanim: ")
    assert shown.err.count("\n") == 1
    assert "Traceback" not in shown.err
    assert re.search(message, shown.err), shown.err
    assert sorted(files.rglob("*")) == before


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (("words.avi", "long.avi"), "words.avi: cannot be opened as a video"),
        (("cut.avi", "long.avi"), "cut.avi: ends after"),
        (("97", "98"), "camera 97 does not open"),
    ],
)
def test_video_libraries_do_not_talk_beside_the_message(sources, message, files):
    whole = (files / "long.avi").read_bytes()
    (files / "cut.avi").write_bytes(whole[: len(whole) * 3 // 4])
    left, right = sources
    line = ["track", "--cameras", "cameras.toml", "--left", left, "--right", right, "--seconds", "1", "--out", "a.trc"]
    done = subprocess.run(
        [sys.executable, "-m", "perfanim.core.cli.main", *line], cwd=files, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert message in done.stderr
    assert not (files / "a.trc").exists()


def test_wrong_board_size_is_told_with_the_right_one(shared_dir, tmp_path, capsys):
    pictures = shared_dir / "stereo" / "opencv-9x6"
    out = tmp_path / "cameras.toml"
    line = ["--left", f"{pictures}/left0[1-4].jpg", "--right", f"{pictures}/right0[1-4].jpg"]
    assert main(["calibrate", "cameras", *line, "--board", "chessboard:8x5:25mm", "--out", str(out)]) == 1
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    assert "board of 9x6 inner corners, not 8x5" in shown.err
    assert not list(tmp_path.iterdir())


def test_a_take_of_other_markers_is_told(files, tmp_path, monkeypatch, capsys, truth, subject):
    """Enough torso markers to go on with, but not the subject's set: solved, and said."""
    take = simulate_markers(truth, subject)[0]
    renamed = tuple("X9" if name == take.names[-1] else name for name in take.names)
    save_take(replace(take, names=renamed), tmp_path / "other.take.npz")
    monkeypatch.chdir(files)
    line = SOLVE.replace("walk.take.npz", str(tmp_path / "other.take.npz")).replace(
        "out/a.bvh", str(tmp_path / "a.bvh")
    )
    assert main(line.split()) == 0
    told = capsys.readouterr().out
    assert f"not in the take: {take.names[-1]}" in told
    assert "left out: X9" in told
