"""Labels of other systems: which marker of which set they are."""

import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.cli.main import main
from perfanim.core.errors import MarkerSetError, TakeError
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.labelling.take_import import import_take
from perfanim.core.markers.label_matching import load_names, match_best_set, match_labels, rename_labels
from perfanim.core.markers.marker_set import PointKind, load_marker_set, marker_set_names
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.from_motion import frames_of

SUITS = ("cmu-41", "helen-hayes", "optitrack-baseline", "plug-in-gait")
KEYPOINTS = ("body-25", "halpe-26", "opencap")
EXACT_M = 0.005  # half the residual that a fitted real suit leaves


@pytest.mark.parametrize("name", marker_set_names())
@pytest.mark.parametrize("written", ["{}", "Anna:{}", "Skeleton 001:{}", "anna_{}"])
def test_each_set_is_matched_by_its_names(name, written):
    marker_set = load_marker_set(name)
    labels = [written.format(marker).lower() for marker in marker_set.names]
    match = match_best_set([*labels, "*41", "unnamed"], "take")
    assert set(match.marker_set.names) == set(marker_set.names)
    assert match_labels(labels, marker_set).label_of == dict(zip(marker_set.names, labels, strict=True))


def test_other_spellings_are_matched():
    match = match_best_set(["RASI", "LASI", "VSAC", "RSHO", "R Knee", "l_ankle", "L.ASIS"], "take")
    assert match.marker_set.name == "helen-hayes"
    assert match.label_of["R.Knee"] == "R Knee"
    assert match.label_of["L.Ankle"] == "l_ankle"
    assert match.label_of["L.ASIS"] == "L.ASIS"  # its own name before another
    take = MarkerTake("a", 60.0, ("RASI", "x", "VSAC"), np.zeros((2, 3, 3)))
    assert match.rename(take).names == ("R.ASIS", "x", "V.Sacral")


@pytest.mark.parametrize(
    ("labels", "name", "matched"),
    [
        # Pose2Sim's HALPE-26 and BODY-25 without the face, and OpenCap's names beside them
        ("Hip RHip RKnee RAnkle RBigToe RSmallToe RHeel LHip LKnee LAnkle LBigToe LSmallToe LHeel Neck Head Nose "
         "RShoulder RElbow RWrist LShoulder LElbow LWrist", "halpe-26", 22),
        ("CHip RHip RKnee RAnkle RBigToe RSmallToe RHeel LHip LKnee LAnkle LBigToe LSmallToe LHeel Neck Nose REye LEye "
         "REar LEar RShoulder RElbow RWrist LShoulder LElbow LWrist", "body-25", 25),
        ("Neck RShoulder RElbow RWrist LShoulder LElbow LWrist midHip RHip RKnee RAnkle LHip LKnee LAnkle r.ASIS_study "
         "L.ASIS_study r.PSIS_study L.PSIS_study r_knee_study L_mknee_study C7_study r_thigh1_study RHJC_study",
         "opencap", 23),
        # MediaPipe's landmarks, and FreeMoCap's names for them
        ("NOSE LEFT_EYE_INNER LEFT_SHOULDER RIGHT_SHOULDER LEFT_ELBOW LEFT_HIP RIGHT_HIP LEFT_FOOT_INDEX MOUTH_LEFT",
         "blazepose-33", 9),
        ("body_nose body_left_eye_inner body_left_shoulder body_right_shoulder body_left_hip body_left_foot_index "
         "body_left_heel left_hand_0000 left_hand_0001 left_hand_0002 right_hand_0000 face_0000", "blazepose-33", 7),
        ("nose left_eye left_shoulder right_shoulder left_hip right_hip left_wrist", "coco-17", 7),
    ],
)  # fmt: skip
def test_keypoints_are_recognised_by_their_labels(labels, name, matched):
    match = match_best_set(labels.split(), "take")
    assert (match.marker_set.name, len(match.label_of)) == (name, matched)
    assert match.marker_set.points is PointKind.KEYPOINTS


def test_unknown_names_are_refused():
    with pytest.raises(TakeError, match=r"P1, P2, P3.* any shipped marker set; choose the marker set"):
        match_best_set(["P1", "P2", "P3"], "take")


def test_names_are_given_by_a_file(tmp_path):
    (tmp_path / "names.toml").write_text('[names]\n"Knee 1" = "LKNE"\n"M7" = "LANK"\n')
    take = MarkerTake("a", 60.0, ("Knee 1", "LKNE", "x"), np.zeros((2, 3, 3)))
    named = rename_labels(take, load_names(tmp_path / "names.toml"))
    assert named.names == ("LKNE", "other LKNE", "x")
    with pytest.raises(TakeError, match="has none of the labels Q, only Knee 1, LKNE, x"):
        rename_labels(take, {"Q": "LKNE"})
    with pytest.raises(TakeError, match="several labels are mapped to LKNE"):
        rename_labels(take, {"Knee 1": "LKNE", "x": "LKNE"})
    for text in ("", "[names]\na = 1\n", 'names = "a"', '[names]\na = ""\n'):
        (tmp_path / "names.toml").write_text(text)
        with pytest.raises(MarkerSetError, match=r"a table \[names\] of names, each with a non-empty string"):
            load_names(tmp_path / "names.toml")


def test_subject_keeps_other_spellings(tmp_path):
    subject = Subject("anna", default_skeleton(), load_marker_set("helen-hayes"))
    save_subject(subject, tmp_path / "anna.toml")
    assert load_subject(tmp_path / "anna.toml").marker_set == subject.marker_set


@pytest.mark.parametrize("name", [*SUITS, *KEYPOINTS])
def test_marker_sets_are_symmetric(name):
    """Left and right markers are each other's mirror images but for those that tell the sides apart."""
    marker_set = load_marker_set(name)
    markers = {marker.name: marker for marker in marker_set.markers}
    alike = 0
    for left, right in ((m, "R" + m[1:]) for m in markers if m.startswith("L") and "R" + m[1:] in markers):
        own, other = markers[left], markers[right]
        assert (own.text, own.joint) == (other.text.replace("right", "left"), "l" + other.joint[1:]) or (
            own.joint == other.joint
        )
        alike += np.allclose(own.offset_m, np.multiply(other.offset_m, (-1.0, 1.0, 1.0)))
    assert alike >= 9


def test_marker_set_is_found_by_labels_and_solved(truth, database_file, tmp_path, capsys, database):
    """Labels with a subject, as Motive writes them, and one marker by hand, in a file with z up."""
    marker_set = load_marker_set("optitrack-baseline")
    take, _ = simulate_markers(sliced(truth, 0, 12), marker_set)
    labels = tuple("Point 7" if name == "Chest" else f"Skeleton 001:{name}" for name in take.names)
    z_up = take.positions_m @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]).T
    write_take(replace(take, names=labels, positions_m=z_up), tmp_path / "walk.c3d")
    (tmp_path / "names.toml").write_text('[names]\n"Point 7" = "Chest"\n')
    save_subject(Subject("walker", truth.skeleton, marker_set), tmp_path / "walker.toml")
    line = ["solve", tmp_path / "walk.c3d", "--database", database_file, "--subject", tmp_path / "walker.toml"]
    line += ["--marker-set", "auto", "--names", tmp_path / "names.toml", "--up", "auto", "--out", tmp_path / "a.bvh"]
    assert main([*map(str, line), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["marker_set"], told["markers"], told["warnings"]) == ("optitrack-baseline", 41, [])
    assert told["marker_rms_mm"] < 1e3 * EXACT_M


@pytest.mark.parametrize(
    ("file", "name", "matched", "frames"),
    [
        pytest.param(
            *("trc/BTKData/TRCSamples/MOTEK/ballet_reduced.trc", "cmu-41", 41, slice(0, 20)), marks=pytest.mark.long
        ),
        ("c3d/BTKData/others/Gait.c3d", "helen-hayes", 24, slice(200, 220)),
        ("c3d/jstoecker_c3dviewer/examples/running.c3d", "plug-in-gait", 30, slice(300, 320)),
    ],
)
def test_real_marker_sets_are_solved(shared_dir, database, file, name, matched, frames):
    """The limbs of an average body are where the performer's are, and on the same side."""
    take = read_take(shared_dir / file)
    match = match_best_set(take.names, file)
    assert (match.marker_set.name, len(match.label_of)) == (name, matched)
    subject = Subject("average", default_skeleton(), match.marker_set)
    part = import_take(frames_of(take, frames), match.marker_set, "auto")
    pose = solve_take(part, subject, database, SolveSettings(), lambda *_: None).poses_of()[-1]
    solved = dict(zip(match.marker_set.names, pose.markers_m, strict=True))
    seen = {n: p for n, p in zip(solved, pose.observed_m, strict=True) if np.isfinite(p[0])}
    pairs = [(n, "R" + n[1:]) for n in seen if n.startswith("L") and "R" + n[1:] in seen]
    assert len(pairs) >= 8
    for left, right in pairs:
        for own, other in ((left, right), (right, left)):
            near, far = (np.linalg.norm(solved[own] - seen[key]) for key in (own, other))
            assert near < 0.5 * far or far < 0.1, own
