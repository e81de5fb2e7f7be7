"""`perfanim take import`: marker takes of other systems become recorded ones; and captures solved anew stay takes."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import resampled
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.labelling.take_import import import_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import save_subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.assets import MARKER_SETS, MOTION

FPS = 30.0
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # (x, y, z) here is (x, -z, y) there
ROUNDED_M = 1e-6  # what the formats keep of positions some metres from the origin


@pytest.fixture(scope="module")
def walk(true_markers, subject):
    return MarkerTake("walk", FPS, subject.marker_set.names, true_markers[:20])


@pytest.fixture
def subject_file(subject, tmp_path):
    save_subject(subject, tmp_path / "walker.toml")
    return tmp_path / "walker.toml"


@pytest.fixture
def bring(tmp_path, subject_file, database_file, capsys):
    """bring(files, options) -> the command's answer."""

    def run(*files, options=()):
        line = ["take", "import", *files, "--out", tmp_path / "takes", "--subject", subject_file]
        assert main([*map(str, [*line, "--database", database_file, *options]), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


def z_up(take):
    return replace(take, positions_m=take.positions_m @ Z_UP.T)


def test_takes_of_all_formats_are_solved_and_kept(bring, tmp_path, walk, subject, database):
    files = [tmp_path / f"Walk {i}.{ending}" for i, ending in enumerate(("c3d", "trc", "csv", "take.npz"))]
    for file in files:
        write_take(z_up(walk) if file.suffix == ".c3d" else walk, file)
    answer = bring(*files)
    assert (len(answer["takes"]), answer["failed"]) == (4, [])
    for number, (file, row) in enumerate(zip(files, answer["takes"], strict=True)):
        assert (row["warnings"], row["frames"]) == ([], walk.frames)
        take = read_take_file(tmp_path / "takes" / f"Walk {number}.perftake")
        assert str(take.path) == row["out"]
        assert (take.complete, take.problems, take.notes.name) == (True, [], f"Walk {number}")
        assert (take.setup.camera_rig(), take.setup.subjects()[0].name) == (None, subject.name)
        read = import_take(read_take(file), subject.marker_set, "auto")
        np.testing.assert_allclose(read.positions_m, walk.positions_m, atol=ROUNDED_M)
        np.testing.assert_array_equal(read_take(take.path).positions_m, read.positions_m)
    solved = solve_take(read, subject, database, SolveSettings(), lambda *_: None)
    for kept, pose in zip(take.poses, solved.poses, strict=True):
        np.testing.assert_array_equal(kept.pose.performers[0].rotations, pose.performers[0].rotations)
    (again,) = bring(files[-1])["takes"]
    assert read_take_file(again["out"]).notes.name == "Walk 3 (2)"


def test_a_bad_file_does_not_keep_the_others_out(bring, tmp_path, walk):
    write_take(walk, tmp_path / "a.c3d")
    (tmp_path / "b.c3d").write_bytes((tmp_path / "a.c3d").read_bytes()[:300])
    (tmp_path / "c.trc").write_text("no markers")
    write_take(
        replace(walk, names=tuple(f"M{i}" for i in range(8)), positions_m=0.0 * walk.positions_m), tmp_path / "d.csv"
    )
    whole = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "e.c3d").write_bytes(whole[: len(whole) - 512 * 2])
    answer = bring(*(tmp_path / name for name in ("b.c3d", "a.c3d", "c.trc", "d.csv", "e.c3d")))
    assert [row["take"] for row in answer["takes"]] == ["a.c3d", "e.c3d"]
    assert answer["takes"][1]["warnings"][0].endswith(f"of {walk.frames} frames")
    assert [text.partition(": ")[0].rpartition("/")[2] for text in answer["failed"]] == ["b.c3d", "c.trc", "d"]
    assert sorted(path.name for path in (tmp_path / "takes").iterdir()) == ["a.perftake", "e.perftake"]


def test_markers_that_were_not_worn_are_not_hidden_ones(bring, tmp_path, walk, subject_file, database_file, capsys):
    """Of a suit's set few takes have all: who lacks some is told so, and is as sure of the others."""
    kept = [at for at, name in enumerate(walk.names) if name != "LFOO"]
    part = replace(walk, names=tuple(walk.names[at] for at in kept), positions_m=walk.positions_m[:, kept])
    write_take(part, tmp_path / "part.csv")
    (row,) = bring(tmp_path / "part.csv")["takes"]
    guessed = "no marker determines the left leg: its pose is guessed"
    assert row["warnings"] == ["not in part.csv: LFOO", f"part.csv: {guessed}"]
    take = read_take_file(row["out"])
    assert take.setup.subjects()[0].marker_set.names == part.names
    assert not any("hidden" in note.text for kept in take.poses for note in kept.pose.notes)
    line = ["batch", tmp_path / "part.csv", "--out", tmp_path / "solved", "--subject", subject_file]
    assert main([*map(str, [*line, "--database", database_file]), "--jobs", "1", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["takes"]
    assert told["warnings"] == ["not in the take: LFOO"]
    assert told["figures"]["hidden"] == 0
    assert told["figures"]["confidence"] == pytest.approx(row["confidence"], abs=1e-3)


def test_markers_that_no_set_knows_are_placed_if_the_labels_choose_the_set(bring, tmp_path, walk):
    hips = [walk.names.index(name) for name in ("LWAI", "RWAI")]
    positions = np.concatenate((walk.positions_m, walk.positions_m[:, hips].mean(axis=1, keepdims=True)), axis=1)
    write_take(replace(walk, names=(*walk.names, "knob"), positions_m=positions), tmp_path / "a.csv")
    for options, placed in ((("--marker-set", "auto"), ["knob"]), ((), [])):
        (row,) = bring(tmp_path / "a.csv", options=options)["takes"]
        worn = read_take_file(row["out"]).setup.subjects()[0].marker_set
        assert [marker.name for marker in worn.markers if marker.placed] == placed


def test_markers_that_no_body_explains_are_told(bring, tmp_path, walk):
    exchanged = replace(walk, names=tuple(reversed(walk.names)))
    write_take(exchanged, tmp_path / "exchanged.csv")
    (row,) = bring(tmp_path / "exchanged.csv", options=("--up", "y"))["takes"]
    assert row["marker_rms_mm"] > 100.0
    assert row["warnings"][0] == f"exchanged.csv: {row['verdict']}"
    assert "from its markers" in row["verdict"] or "no body fits the markers" in row["verdict"]


def test_nothing_that_can_be_used_is_an_error(tmp_path, subject_file, database_file, capsys):
    (tmp_path / "words.trc").write_text("no markers")
    line = ["take", "import", tmp_path / "words.trc", "--out", tmp_path / "takes", "--subject", subject_file]
    assert main([*map(str, line), "--database", str(database_file)]) == 1
    assert "words.trc" in capsys.readouterr().err
    assert not (tmp_path / "takes").exists()
    assert main([*map(str, line[:-2]), "--database", str(database_file), "--marker-set", "kendo", "--height", "3"]) == 1
    assert "1 to 2.5" in capsys.readouterr().err


def test_none_that_is_there_is_replaced_and_recorded_takes_are_copied(bring, tmp_path, walk):
    write_take(walk, tmp_path / "walk.csv")
    bring(tmp_path / "walk.csv")
    first = (tmp_path / "takes" / "walk.perftake").read_bytes()
    again = bring(tmp_path / "walk.csv", tmp_path / "takes" / "walk.perftake")
    assert [row["out"].rpartition("/")[2] for row in again["takes"]] == ["walk (2).perftake", "walk (3).perftake"]
    assert (tmp_path / "takes" / "walk.perftake").read_bytes() == first
    copy, source = (read_take_file(tmp_path / "takes" / f"walk{name}.perftake") for name in (" (3)", ""))
    assert (copy.complete, copy.notes) == (True, source.notes)
    assert [pose.pose.number for pose in copy.poses] == [pose.pose.number for pose in source.poses]


@pytest.mark.long
def test_a_full_suit_of_another_system_is_solved_to_a_body(shared_dir, tmp_path, database_file, capsys):
    """Plug-in Gait by Vicon, z up, somebody who stands; the average body is of another size."""
    source = shared_dir / "c3d" / "BTKData" / "PiG" / "PiG_Calibration-FlatFoot-Full.c3d"
    line = ["take", "import", source, "--out", tmp_path, "--database", database_file, "--marker-set", "plug-in-gait"]
    assert main([*map(str, line), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["takes"]
    assert row["warnings"] == [f"not in {source.name}: LUPA, RUPA, LFRM, RFRM, SACR"]
    kept = read_take_file(row["out"])
    pose, names = kept.poses[-1].pose.performers[0], kept.setup.subjects()[0].marker_set.names
    assert len(names) == len(load_marker_set("plug-in-gait")) - 5
    solved = dict(zip(names, pose.markers_m, strict=True))
    seen = {n: p for n, p in zip(names, pose.observed_m, strict=True) if np.isfinite(p[0])}
    heights = [solved[name][1] for name in ("LTOE", "LKNE", "LASI", "CLAV", "LFHD")]
    assert heights == sorted(heights)
    for left in ("LSHO", "LELB", "LFIN", "LASI", "LKNE", "LANK", "LTOE"):
        for name, other in ((left, "R" + left[1:]), ("R" + left[1:], left)):
            own, mirrored = (np.linalg.norm(solved[name] - seen[key]) for key in (name, other))
            assert own < 0.5 * mirrored, name
    knees = 0.5 * (solved["LKNE"] + solved["RKNE"])
    toes, heels = (0.5 * (solved["L" + n] + solved["R" + n]) for n in ("TOE", "HEE"))
    forward = (toes - heels) / np.linalg.norm(toes - heels)
    hips = 0.25 * (solved["LASI"] + solved["RASI"] + solved["LPSI"] + solved["RPSI"])
    ankles = 0.5 * (solved["LANK"] + solved["RANK"])
    assert (knees - 0.5 * (hips + ankles)) @ forward > -0.02  # knees do not bend backwards


def test_exchanged_labels_are_put_back_and_told_unless_trusted(bring, tmp_path, walk):
    feet, positions = [walk.names.index(name) for name in ("LFOO", "RFOO")], walk.positions_m.copy()
    positions[6:14, feet] = positions[6:14, feet[::-1]]
    write_take(replace(walk, positions_m=positions), tmp_path / "walk.csv")
    (row,) = bring(tmp_path / "walk.csv")["takes"]
    assert any("walk.csv: LFOO and RFOO had each other's labels" in text for text in row["warnings"])
    np.testing.assert_allclose(read_take(row["out"]).positions_m, walk.positions_m, atol=ROUNDED_M)
    (trusted,) = bring(tmp_path / "walk.csv", options=["--trust-labels"])["takes"]
    assert not any("each other's labels" in text for text in trusted["warnings"])
    np.testing.assert_allclose(read_take(trusted["out"]).positions_m, positions, atol=ROUNDED_M)


def test_without_a_performer_the_body_is_fitted(walk, tmp_path, database_file, capsys):
    write_take(z_up(walk), tmp_path / "walk.c3d")
    line = ["take", "import", tmp_path / "walk.c3d", "--out", tmp_path / "takes", "--database", database_file]
    heights = {}
    for options in ((), ("--height", "2.0")):
        assert main([*map(str, [*line, *options]), "--json"]) == 0
        (row,) = json.loads(capsys.readouterr().out)["takes"]
        (performer,) = read_take_file(row["out"]).setup.subjects()
        heights[options] = (performer.name, row["marker_rms_mm"])
    assert [name for name, _ in heights.values()] == ["performer", "average body"]
    fitted, average = (rms for _, rms in heights.values())
    assert fitted < 0.5 * average  # a body of 2 m does not explain these markers


@pytest.mark.long
def test_two_films_become_a_take(tmp_path, capsys):
    """Simulated cameras and markers; nothing is named but one film and the set."""
    studio, takes = tmp_path / "studio", tmp_path / "takes"
    short = ["--t-pose", "0", "--background", "2", "--board-views", "2", "--fps", "30"]
    assert main(["simulate", "cameras", str(MOTION / "walking-01-neutral.bvh"), "--out", str(studio), *short]) == 0
    shutil.copy(studio / "truth" / "cameras.toml", studio)
    shutil.rmtree(studio / "board")
    capsys.readouterr()
    film = next(studio.glob("*.mkv"))
    line = ["take", "import", film, "--marker-set", "boxing", "--out", takes, "--json"]
    assert main(list(map(str, line))) == 0
    (row,) = json.loads(capsys.readouterr().out)["takes"]
    take, truth = read_take_file(row["out"]), read_motion(studio / "truth" / "motion.bvh")
    assert row["cameras"] == str(studio / "cameras.toml")
    assert row["marker_rms_mm"] < 20.0
    motion = motion_of(take.recorded_poses_of(), take.setup.subjects()[0], "film", 30.0)
    solved, true = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0]
        for each in (motion, resampled(truth, 30.0))
    )
    frames = min(len(solved), len(true))
    assert np.median(np.linalg.norm(solved[:frames] - true[:frames], axis=-1)) < 0.08  # the body is fitted, too
    assert sorted(take.setup.capture["tracked"]) == sorted(map(str, studio.glob("*.mkv")))  # for reference pictures
    rigs = take.setup.camera_rig(), load_rig(row["cameras"])
    assert row["camera_heights_mm"] == pytest.approx(rigs[1].heights_mm, abs=80.0)  # above the floor under the feet
    centres = [[camera.centre_m for camera in rig.cameras] for rig in rigs]
    assert np.linalg.norm(np.subtract(*centres), axis=1).max() < 0.08

    whole = (MARKER_SETS / "boxing.toml").read_text().split("[[marker]]")
    few = [block for block in whole if not re.search('"([LR]HAN|LFOO)"', block)]  # without three that are worn
    (tmp_path / "few.toml").write_text("[[marker]]".join(few))
    line[line.index("boxing")] = tmp_path / "few.toml"
    assert main(list(map(str, line))) == 0
    (row,) = json.loads(capsys.readouterr().out)["takes"]
    assert re.match("nearly every frame shows [89] markers, but 6 are worn", row["verdict"])
    assert read_take_file(row["out"]).notes.verdict == row["verdict"]
