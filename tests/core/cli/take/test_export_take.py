"""`perfanim take` and solving recorded takes: as live, with another calibration, of cut files."""

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from commands import run
from perfanim.core.body.clock import poses_at
from perfanim.core.body.pose_notes import NoteKind, PoseNote
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.database.store import identity
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file import take_writer as writer_module
from perfanim.core.formats.take_file.append_notes import append_notes
from perfanim.core.formats.take_file.chunks import scan
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter, WriterSettings
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.markers.marker_take import MarkerTake, save_take
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.session.delayed_poses import DelayedPoses
from perfanim.core.session.session import Session
from perfanim.core.solver.settings import SolveSettings

LOST = (20, 21, 22)  # frames that the cameras left out
FPS = 30.0
TOLD = (
    "3 of 60 frames are missing, at most 0.13 s in a row (28.5 frames per second on average): "
    "motion is interpolated there, markers are not"
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, true_markers, subject, database, stage_rig, record):
    """A take of two seconds without three frames, a little of it in every chunk, and its live poses."""
    folder = tmp_path_factory.mktemp("recorded")
    setup = TakeSetup.of(stage_rig, (subject,), {"best_neighbours": 200}, identity(database), {})
    session = Session(subject, database, stage_rig, SolveSettings.of_table(setup.settings))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))  # this plays the thread
        held, delayed = deque(), DelayedPoses(noise_of(subject.marker_set.points))
        writer = TakeWriter(folder / "walk.perftake", setup, TakeNotes("Walk 1", character="Xbot"))
        for number in (n for n in range(len(true_markers)) if n not in LOST):
            frame = record(true_markers[number], number, cameras=True, fps=FPS, hidden=((5, 0),) if number > 40 else ())
            writer.add_frame(pack_stamped(float(number), frame))
            held.append(TimedPose(ScenePose((session.step(frame),)), float(number)))
            calm = delayed.step(held[-1].pose)
            if calm is not None:
                writer.add_pose(pack_solved(replace(held.popleft(), pose=calm)))
            if number % 3 == 0:
                writer._collect()
        for calm in delayed.rest():
            writer.add_pose(pack_solved(replace(held.popleft(), pose=calm)))
        writer.close()
    save_rig(stage_rig, folder / "rig.toml")
    return folder / "walk.perftake"


def test_info(recorded, capsys):
    facts = run(capsys, "take", "info", recorded)
    expected = {
        "name": "Walk 1", "frames": 57, "poses": 57, "complete": True, "lost_frames": 3, "gaps": 0,
        "markers": 8, "fps": 30.0, "cameras": 2, "subject": "walker", "marker_set": "locomotion", "character": "Xbot",
        "problems": [],
    }  # fmt: skip
    assert {key: facts[key] for key in expected} == expected
    assert facts["duration_s"] == pytest.approx(59 / 30)
    assert facts["confidence"] > 0.5
    assert main(["take", "info", str(recorded)]) == 0
    assert "lost frames: 3" in capsys.readouterr().out


def test_info_tells_why_a_take_was_solved_as_it_was(recorded, tmp_path, capsys):
    take, cut = read_take_file(recorded), PoseNote.of(NoteKind.CUT)
    poses = [
        replace(solved, pose=replace(solved.pose, notes=(cut,) * (at == 10))) for at, solved in enumerate(take.poses)
    ]
    write_whole_take(tmp_path / "cut.perftake", take.setup, take.notes, take.stamped_frames, poses)
    (told,) = run(capsys, "take", "info", "--why", tmp_path / "cut.perftake")["decisions"]
    assert (told["reason"], told["first"], told["last"]) == (cut.text, 10, 10)
    assert told["start_s"] == pytest.approx(poses[10].pose.time_s - poses[0].pose.time_s)
    assert main(["take", "info", "--why", str(tmp_path / "cut.perftake")]) == 0
    assert cut.text in capsys.readouterr().out
    run(capsys, "take", "export", recorded, "--out", tmp_path / "walk.csv")
    assert main(["take", "info", "--why", str(tmp_path / "walk.csv")]) == 1
    assert "has no poses" in capsys.readouterr().err


def test_info_of_other_systems_takes(tmp_path, recorded, capsys):
    markers = read_take(recorded)
    for ending in ("c3d", "trc", "csv", "take.npz"):
        run(capsys, "take", "export", recorded, "--out", tmp_path / f"a.{ending}")
        facts = run(capsys, "take", "info", tmp_path / f"a.{ending}")
        assert facts["complete"]
        assert (facts["markers"], facts["names"], facts["fps"]) == (8, list(markers.names), 30.0)
        assert facts["frames"] + facts["lost_frames"] == 60
        assert facts["duration_s"] == pytest.approx(59 / 30, abs=1e-5)
        again = read_take(tmp_path / f"a.{ending}")
        rows = np.searchsorted(again.frame_numbers - again.frame_numbers[0], markers.frame_numbers)
        np.testing.assert_allclose(again.positions_m[rows], markers.positions_m, atol=1e-6)
    for ending, keep in (("c3d", -5000), ("trc", -3000)):
        whole = (tmp_path / f"a.{ending}").read_bytes()
        cut = whole[:keep] if ending == "c3d" else whole[: whole.rindex(b"\n", 0, keep)]
        (tmp_path / f"cut.{ending}").write_bytes(cut)
        facts = run(capsys, "take", "info", tmp_path / f"cut.{ending}")
        assert not facts["complete"]
        assert ["cut off" in problem for problem in facts["problems"]] == [True]


def test_info_of_several_takes_lists_the_main_facts_of_each(tmp_path, recorded, capsys):
    (tmp_path / "bad.c3d").write_bytes(b"no markers")
    facts = run(capsys, "take", "info", recorded, tmp_path / "bad.c3d")
    assert facts["takes"][str(recorded)]["frames"] == 57
    assert set(facts["takes"]) == {str(recorded)}
    assert [("bad.c3d" in line, "is not a C3D file" in line) for line in facts["failed"]] == [(True, True)]
    assert main(["take", "info", str(tmp_path / "bad.c3d"), str(tmp_path / "bad.c3d")]) == 1
    assert main(["take", "info", str(recorded), str(recorded)]) == 0
    assert f"  {recorded}: frames=57 fps=30" in capsys.readouterr().out


def test_exported_motion_keeps_its_time_where_frames_were_lost(tmp_path, recorded, capsys):
    facts = run(capsys, "take", "export", recorded, "--out", tmp_path / "a.bvh")
    motion = read_motion(tmp_path / "a.bvh")
    assert (facts["frames"], motion.frames, motion.fps) == (60, 60, pytest.approx(30.0, abs=1e-3))
    poses = {solved.pose.number: solved.pose.performers[0] for solved in read_take_file(recorded).poses}
    for number, pose in poses.items():
        assert np.degrees(rot.angle_between(motion.rotations[number], pose.rotations)).max() < 0.01
        np.testing.assert_allclose(motion.root_positions_m[number], pose.root_position_m, atol=1e-5)
    times_s = np.array(list(poses)) / FPS
    rows = [np.array([getattr(pose, name) for pose in poses.values()]) for name in ("rotations", "root_position_m")]
    between = poses_at(times_s, *rows, np.array(LOST) / FPS)[1]
    np.testing.assert_allclose(motion.root_positions_m[list(LOST)], between, atol=1e-5)
    assert facts["warnings"] == [TOLD]


def test_motion_is_exported_for_other_programs(tmp_path, recorded, capsys):
    given = ("take", "export", recorded, "--rate", 15, "--naming", "unreal", "--units", "cm", "--out")
    for name in ("a.bvh", "a.angles.csv", "a.vrma"):
        facts = run(capsys, *given, tmp_path / name)
        assert (facts["frames"], facts["fps"]) == (30, 15.0)
    read = read_bvh(tmp_path / "a.bvh")
    assert (read.frames, read.fps, read.names[0], read.metres_per_unit) == (30, 15.0, "pelvis", 0.01)
    table = (tmp_path / "a.angles.csv").read_text()
    assert ",hand_l_z_deg," in table
    assert b"VRMC_vrm_animation" in (tmp_path / "a.vrma").read_bytes()
    assert main(["take", "export", str(recorded), "--out", str(tmp_path / "a.obj")]) == 1
    assert "use one of .bvh, .angles.csv, .vrma" in capsys.readouterr().err


def test_solve_writes_any_kind_of_motion(tmp_path, recorded, capsys):
    given = ("solve", recorded, "--method", "nearest", "--rate", "15", "--naming", "vrm", "--out")
    assert run(capsys, *given, tmp_path / "a.angles.csv")["fps"] == 15.0
    assert ",leftHand_z_deg," in (tmp_path / "a.angles.csv").read_text()
    assert main([*map(str, given), str(tmp_path / "a.csv")]) == 1
    assert "a.csv: does not have the extension of a motion file" in capsys.readouterr().err


def test_solving_again_gives_what_live_gave(tmp_path, recorded, capsys):
    facts = run(capsys, "solve", recorded, "--causal", "--out", tmp_path / "again.bvh")
    assert (facts["frames"], facts["complete"], facts["method"], facts["warnings"]) == (57, True, "best", [TOLD])
    run(capsys, "take", "export", recorded, "--out", tmp_path / "live.bvh")
    again, live = read_motion(tmp_path / "again.bvh"), read_motion(tmp_path / "live.bvh")
    assert np.degrees(rot.angle_between(again.rotations, live.rotations)).max() < 0.01  # what BVH keeps
    other = run(capsys, "solve", recorded, "--method", "lwr", "--out", tmp_path / "lwr.bvh")
    assert other["method"] == "lwr"
    run(capsys, "solve", recorded, "--feet", "auto", "--out", tmp_path / "feet.bvh")
    held = read_motion(tmp_path / "feet.bvh")
    balls = [held.skeleton.index(name) for name in ("ltoes", "rtoes")]
    slow = []
    for motion in (held, again):
        path = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][:, balls][..., [0, 2]]
        slow.append(np.percentile(np.linalg.norm(np.diff(path, axis=0), axis=-1), 25))
    assert slow[0] < 0.5 * slow[1]  # in walking each foot stands for more than half of the time


@pytest.mark.long
def test_solving_again_from_the_detections_alone(tmp_path, recorded, stage_rig, capsys):
    quick = ("--method", "nearest")
    facts = run(capsys, "solve", recorded, *quick, "--out", tmp_path / "a.bvh")
    rig = recorded.parent / "rig.toml"
    anew = run(capsys, "solve", recorded, *quick, "--cameras", rig, "--out", tmp_path / "b.bvh")
    assert anew["marker_rms_mm"] == pytest.approx(facts["marker_rms_mm"], abs=0.5)
    a, b = read_motion(tmp_path / "a.bvh"), read_motion(tmp_path / "b.bvh")
    assert np.linalg.norm(a.root_positions_m - b.root_positions_m, axis=1).max() < 0.005
    save_rig(type(stage_rig)(stage_rig.cameras[:1]), tmp_path / "one.toml")
    assert (
        main(["solve", str(recorded), "--cameras", str(tmp_path / "one.toml"), "--out", str(tmp_path / "c.bvh")]) == 1
    )
    assert "was recorded by 2 cameras, but the calibration has 1" in capsys.readouterr().err


def test_a_countdown_stays_in_the_take_and_out_of_the_motion(tmp_path, recorded, capsys):
    part = tmp_path / "part.perftake"
    part.write_bytes(recorded.read_bytes())
    append_notes(part, replace(read_take_file(part).notes, recorded=(10, 40)))
    facts = run(capsys, "take", "info", part)
    assert (facts["frames"], facts["recorded"], facts["complete"]) == (57, [10, 40], True)
    run(capsys, "take", "export", part, "--out", tmp_path / "live.bvh")
    run(capsys, "take", "export", recorded, "--out", tmp_path / "all.bvh")
    live, everything = read_motion(tmp_path / "live.bvh"), read_motion(tmp_path / "all.bvh")
    assert live.frames == 31
    np.testing.assert_allclose(live.root_positions_m, everything.root_positions_m[10:41], atol=1e-9)
    run(capsys, "solve", part, "--causal", "--out", tmp_path / "again.bvh")
    assert np.degrees(rot.angle_between(read_motion(tmp_path / "again.bvh").rotations, live.rotations)).max() < 0.01
    run(capsys, "solve", part, "--method", "nearest", "--out", tmp_path / "anew.perftake")
    anew = read_take_file(tmp_path / "anew.perftake")
    assert (anew.notes.recorded, len(anew.poses)) == ((10, 40), 57)
    run(capsys, "take", "export", part, "--out", tmp_path / "markers.take.npz")
    assert list(read_take(tmp_path / "markers.take.npz").frame_numbers[[0, -1]]) == [10, 40]


def test_a_cut_take_is_recovered_and_solved(tmp_path, recorded, capsys):
    chunks, _ = scan(recorded.read_bytes(), "")
    cut = tmp_path / "cut.perftake"
    cut.write_bytes(recorded.read_bytes()[: chunks[20].offset + 99])
    before = cut.read_bytes()
    facts = run(capsys, "take", "info", cut)
    assert not facts["complete"]
    assert facts["problems"][0].startswith("the file is cut off within chunk 20")
    solved = run(capsys, "solve", cut, "--out", tmp_path / "a.bvh")
    assert solved["frames"] == facts["frames"] < 57
    *others, told = solved["warnings"]
    assert others == facts["problems"]
    assert told.startswith(f"3 of {facts['frames'] + 3} frames are missing")
    done = run(capsys, "take", "recover", cut)
    assert done["out"] == str(tmp_path / "cut-recovered.perftake")
    assert done["frames"] == facts["frames"]
    again = run(capsys, "take", "info", done["out"])
    assert again["complete"]
    assert again["frames"] == facts["frames"]
    assert cut.read_bytes() == before
    assert main(["take", "recover", str(cut)]) == 1
    assert "already exists" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bvh", "cut-recovered.perftake", "cut.perftake"]


def test_bad_input_is_told_in_one_line(tmp_path, recorded, capsys):
    (tmp_path / "words.perftake").write_text("no take at all, but some words of somebody")
    chunks, _ = scan(recorded.read_bytes(), "")
    (tmp_path / "start.perftake").write_bytes(recorded.read_bytes()[: chunks[0].offset + 9])
    (tmp_path / "bare.perftake").write_bytes(recorded.read_bytes()[: chunks[2].offset])
    save_take(MarkerTake("a", 60.0, ("A",), np.zeros((3, 1, 3))), tmp_path / "a.take.npz")
    lines = {
        "take info {tmp}/gone.perftake": "cannot be read",
        "take info {tmp}/words.perftake": "is not a recorded take",
        "take info {tmp}/start.perftake": "has lost its calibration and subject",
        "take recover {tmp}/start.perftake": "has lost its calibration and subject",
        "take recover {take} --out {tmp}/a.bvh": "a.bvh: does not end in .perftake",
        "take recover {take} --out {take}": "is an input and would be overwritten",
        "take export {take} --out {tmp}/a.doc": "does not have an extension that can be written",
        "take export {tmp}/a.take.npz --out {tmp}/a.bvh": "holds markers, not motion",
        "take export {tmp}/bare.perftake --out {tmp}/b.bvh": "has no poses",
        "take export {tmp}/bare.perftake --out {tmp}/b.csv": "has no poses",
        "solve {tmp}/bare.perftake --out {tmp}/b.bvh": "has 0 poses",
        "calibrate subject {tmp}/bare.perftake --marker-set boxing --out {tmp}/b.toml": "has no poses",
    }  # fmt: skip
    before = sorted(tmp_path.iterdir())
    for line, message in lines.items():
        assert main([part.format(tmp=tmp_path, take=recorded) for part in line.split()]) == 1, line
        printed = capsys.readouterr()
        assert (printed.out, printed.err.count("\n")) == ("", 1), line
        assert message in printed.err
        assert sorted(tmp_path.iterdir()) == before, line


@pytest.mark.parametrize("line", ["solve a.c3d --database d --subject s --cameras c --out b.bvh", "take", "take info"])
def test_wrong_usage_exits_with_2(line, capsys):
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_a_take_solved_anew_is_a_take(recorded, tmp_path, capsys, database_file):
    out = tmp_path / "again.perftake"
    facts = run(capsys, "solve", recorded, "--method", "lwr", "--database", database_file, "--out", out)
    before, after = read_take_file(recorded), read_take_file(out)
    assert (facts["frames"], facts["method"], facts["warnings"]) == (57, "lwr", [TOLD])
    assert (after.complete, after.problems, after.events) == (True, [], before.events)
    assert (after.notes.name, after.notes.character) == ("Walk 1 (lwr)", "")
    for (stamp_s, frame), (again_s, again) in zip(before.stamped_frames, after.stamped_frames, strict=True):
        assert (stamp_s, frame.number, frame.time_s) == (again_s, again.number, again.time_s)
        np.testing.assert_array_equal(frame.detected[1], again.detected[1])
    motion = tmp_path / "again.bvh"
    run(capsys, "solve", recorded, "--method", "lwr", "--database", database_file, "--out", motion)
    run(capsys, "take", "export", out, "--out", tmp_path / "kept.bvh")
    np.testing.assert_array_equal(read_motion(tmp_path / "kept.bvh").rotations, read_motion(motion).rotations)
    listed = summarise(out)
    assert (listed.method, listed.performers, listed.marker_set) == ("lwr", ("walker",), "locomotion")
    assert (listed.database, summarise(recorded).method) == (database_file.stem, "")
    run(capsys, "solve", out, "--method", "nearest", "--database", database_file, "--out", tmp_path / "third.perftake")
    assert summarise(tmp_path / "third.perftake").notes.name == "Walk 1 (nearest)"


def test_a_take_solved_anew_takes_no_other_s_place(recorded, tmp_path, capsys):
    content = recorded.read_bytes()
    assert main(["solve", str(recorded), "--out", str(recorded)]) == 1
    assert "is an input and would be overwritten" in capsys.readouterr().err
    assert recorded.read_bytes() == content
    for wrong in (["--smooth", "6"], ["--feet", "auto"], ["--out", "x.bvh", "--cameras", "y"]):
        with pytest.raises(SystemExit, match="2"):
            main(["solve", "walk.take.npz", "--database", "d", "--subject", "s", "--out", "x.perftake", *wrong])
