"""Marker calibration by itself: the person's bones and the database stay when the markers change."""

import json

import numpy as np
from perfanim.core.body.calibration_poses import CALIBRATION, t_pose
from perfanim.core.body.motion import sliced
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.cli.calibrate.calibrate_subject import worn_facts
from perfanim.core.cli.main import main
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, save_take
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.stage_placement import with_poses
from perfanim.core.subjects.body_change import PARTS, sized


def write_take(path, skeleton, marker_set, rotations, root_positions):
    joints = marker_set.joint_indices(skeleton)
    positions = marker_positions(skeleton, joints, marker_set.offsets_m, rotations, root_positions)
    save_take(MarkerTake(path.stem, 30.0, marker_set.names, positions), path)


def test_a_marker_is_added_without_another_skeleton_or_database(truth, database_file, tmp_path, capsys):
    skeleton = truth.skeleton
    still = np.broadcast_to(t_pose(skeleton), (40, 29, 4)), np.broadcast_to([0.0, 0.95, -3.0], (40, 3))
    for name in ("locomotion", "boxing"):
        write_take(tmp_path / f"{name}.take.npz", skeleton, load_marker_set(name), *still)
    take = tmp_path / "walk.take.npz"
    write_take(take, skeleton, load_marker_set("boxing"), truth.rotations[:8], truth.root_positions_m[:8])
    ann, again, out = tmp_path / "ann.toml", tmp_path / "again.toml", tmp_path / "walk.bvh"
    calibrate = ["calibrate", "subject", str(tmp_path / "boxing.take.npz"), "--marker-set", "boxing"]
    assert main(["calibrate", "subject", str(tmp_path / "locomotion.take.npz"), "--marker-set", "locomotion",
                 "--out", str(ann)]) == 0  # fmt: skip
    assert main([*calibrate, "--skeleton-from", str(ann), "--out", str(again)]) == 0
    before, after = load_subject(ann), load_subject(again)
    assert (after.name, after.marker_set.names) == ("ann", load_marker_set("boxing").names)
    np.testing.assert_array_equal(after.skeleton.offsets_m, before.skeleton.offsets_m)
    capsys.readouterr()
    assert main(["solve", str(take), "--database", str(database_file), "--subject", str(again), "--out", str(out),
                 "--json"]) == 0  # fmt: skip
    assert json.loads(capsys.readouterr().out)["marker_rms_mm"] < 30.0
    assert main([*calibrate, "--skeleton-from", str(ann), "--database", str(database_file), "--out", str(again)]) == 1
    assert "--skeleton-from and --database" in capsys.readouterr().err


def test_several_poses_are_found_in_a_take_and_the_result_says_how_far_to_trust_it(truth, tmp_path, capsys):
    motion = with_poses(sliced(truth, 0, 10), CALIBRATION, 1.2)
    take, out = tmp_path / "poses.take.npz", tmp_path / "ann.toml"
    write_take(take, motion.skeleton, load_marker_set("boxing"), motion.rotations, motion.root_positions_m)
    line = ["calibrate", "subject", str(take), "--marker-set", "boxing", "--out", str(out), "--json"]
    results = []
    for options in ([], ["--poses", "t,hanging,motorcycle"]):
        assert main([*line, *options]) == 0
        results.append(json.loads(capsys.readouterr().out))
        assert load_subject(out).skeleton.names == motion.skeleton.names
    one, three = results
    assert (one["verdict"], three["verdict"]) == ("usable", "good")
    assert "hold these poses as well" in one["advice"][0]
    assert three["open_mm"]["lhumerus"] < one["open_mm"]["lhumerus"]
    assert set(three["marker_residuals_mm"]) == set(load_marker_set("boxing").names)
    assert main([*line, "--poses", "t,yoga"]) == 1
    assert "no calibration pose 'yoga'" in capsys.readouterr().err


def write_ann(truth, folder, too_long=0.0):
    """Ann with too long bones, and a walk of hers with markers that sit elsewhere."""
    usual = load_marker_set("boxing")
    worn = usual.with_offsets(usual.offsets_m + np.random.default_rng(2).normal(scale=0.008, size=(len(usual), 3)))
    skeleton = sized(truth.skeleton, np.full(len(PARTS), too_long))
    save_subject(Subject("Ann", skeleton, usual, 0.006), folder / "ann.toml")
    walk = sliced(truth, 0, 40)
    write_take(folder / "walk.take.npz", walk.skeleton, worn, walk.rotations, walk.root_positions_m)


def test_a_calibrated_subject_is_refined_by_motion(truth, database_file, tmp_path, capsys):
    write_ann(truth, tmp_path, too_long=0.1)
    line = ["calibrate", "subject", str(tmp_path / "walk.take.npz"), "--refine"]
    line += [str(tmp_path / "ann.toml"), "--out", str(tmp_path / "better.toml")]
    assert main(line) == 1
    assert "--refine needs --database" in capsys.readouterr().err
    assert main([*line, "--database", str(database_file)]) == 0
    better = load_subject(tmp_path / "better.toml")
    assert better.name == "Ann"
    assert "changes: whole body" in capsys.readouterr().out
    found, right = (np.linalg.norm(each.offsets_m, axis=1).sum() for each in (better.skeleton, truth.skeleton))
    assert abs(found / right - 1.0) < 0.05


def test_only_a_refined_subject_brings_its_marker_set(truth, database_file, tmp_path, capsys):
    write_ann(truth, tmp_path)
    line = ["calibrate", "subject", str(tmp_path / "walk.take.npz"), "--out", str(tmp_path / "new.toml")]
    assert main(line) == 1
    assert "no marker set is named; give --marker-set" in capsys.readouterr().err


def test_a_take_is_solved_with_the_body_refined_by_it(truth, database_file, tmp_path, capsys):
    write_ann(truth, tmp_path, too_long=0.1)
    take, ann, database = tmp_path / "walk.take.npz", tmp_path / "ann.toml", ["--database", str(database_file)]
    before = ann.read_bytes()
    line = ["solve", str(take), *database, "--subject", str(ann), "--causal", "--out", str(tmp_path / "walk.bvh")]
    found = []
    for options in ([], ["--refine-body"]):
        assert main([*line, *options, "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    plain, refined = found
    assert "changes" not in plain
    assert refined["changes"]
    assert refined["changes"][0].startswith("whole body ")
    assert "smaller (± " in refined["changes"][0]
    assert refined["marker_rms_mm"] < plain["marker_rms_mm"]
    assert ann.read_bytes() == before


def test_a_recorded_take_refines_its_own_performer(truth, database_file, tmp_path, capsys):
    write_ann(truth, tmp_path, too_long=0.1)
    database = ["--database", str(database_file)]
    assert main(["take", "import", str(tmp_path / "walk.take.npz"), "--subject", str(tmp_path / "ann.toml"), *database,
                 "--out", str(tmp_path)]) == 0  # fmt: skip
    take, out = str(tmp_path / "walk.perftake"), tmp_path / "better.toml"
    capsys.readouterr()
    assert main(["calibrate", "subject", take, "--refine", take, *database, "--out", str(out), "--json"]) == 0
    changes = json.loads(capsys.readouterr().out)["changes"]
    assert changes
    assert load_subject(out).name == "Ann"
    assert main(["solve", take, "--refine-body", "--out", str(tmp_path / "again.perftake"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changes"] == changes
    (again,) = read_take_file(tmp_path / "again.perftake").setup.subjects()
    np.testing.assert_allclose(again.marker_set.offsets_m, load_subject(out).marker_set.offsets_m, atol=1e-6)


def test_markers_far_from_their_usual_places_are_told(truth):
    suit = load_marker_set("plug-in-gait")
    take = simulate_markers(sliced(truth, 0, 5), suit)[0]
    offsets = suit.offsets_m.copy()
    offsets[suit.names.index("LKNE")] += [0.0, 0.06, 0.0]
    told = worn_facts(take, suit, Subject("walker", truth.skeleton, suit.with_offsets(offsets)))
    count = len(suit)
    assert told == {"coverage": f"{count} of {count} markers known", "moved_mm": {"LKNE": 60.0}}
