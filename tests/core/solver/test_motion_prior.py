"""The learned prior: its inference, its file, and what it does to the solver."""

import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.motion_prior import VERSION, MotionPrior, RecentMarkers, open_network
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.root import root_from_torso
from perfanim.core.solver.settings import BestSettings, SolveSettings
from perfanim.core.solver.subject_model import RootPose, SubjectModel
from perfanim.core.system.assets import MOTION_PRIOR
from random_prior import HIDDEN, JOINTS, LAGS_S, OUTPUTS, WIDTH, write_network

CMU_PEOPLE = ("03", "05", "07", "09", "127", "13", "131", "135", "14", "16", "29", "35", "49", "86", "91")


@pytest.fixture(scope="module")
def network_file(tmp_path_factory, database):
    return write_network(tmp_path_factory.mktemp("prior") / "prior.npz", database.mean_rotations)


@pytest.fixture(scope="module")
def network(network_file):
    return open_network(network_file)


@pytest.fixture
def points(true_markers):
    """Markers at the lags; some are not seen, one never."""
    points = true_markers[[30, 29, 27, 15]].copy()
    points[0, 5] = points[2, 1] = points[:, 7] = np.nan
    return points


def recent(points, single=()):
    """The same as markers of which one camera alone sees some now."""
    return RecentMarkers(points, np.isin(np.arange(points.shape[1]), single))


def by_hand(network, model, points, single, frame):
    """Outputs and logarithms of sigmas, entry by entry."""
    rest = SubjectModel(model.subject, network.mean_rotations).markers(np.zeros((JOINTS - 1, 3)))
    sums = np.zeros((network.part_of_joint.max() + 1, HIDDEN))
    for marker, joint in enumerate(model.joints):
        seen = [lag for lag in range(len(LAGS_S)) if np.isfinite(points[lag, marker, 0])]
        if not seen:
            continue
        latest = frame.to_root_frame(points[seen[0], marker])
        row = [*(latest - rest[marker]), *(10.0 * model.offsets_m[marker]), *rest[marker]]
        for lag in range(1, len(LAGS_S)):
            here = frame.to_root_frame(points[lag, marker]) if lag in seen else latest
            row += list((here - latest) / (0.03 + LAGS_S[lag]))
        row += [0.5 if lag == 0 and marker in single else float(lag in seen) for lag in range(len(LAGS_S))]
        hidden = np.array(row) @ network.marker_weights[joint] + network.marker_biases[joint]
        sums[network.part_of_joint[joint]] += hidden / (1.0 + np.exp(-hidden))
    lengths = np.linalg.norm(model.skeleton.offsets_m[1:], axis=1)
    bones = (lengths - network.bones[0]) / network.bones[1]
    state = np.concatenate((sums.ravel(), bones)) @ network.first_weights + network.biases[0]
    state = state / (1.0 + np.exp(-state))
    for layer in range(2):
        more = state @ network.weights[layer] + network.biases[1 + layer]
        state = state + more / (1.0 + np.exp(-more))
    return np.split(state @ network.output_weights + network.output_biases, 2)


@pytest.mark.parametrize("single", [(), (2, 3)])
def test_inference_equals_a_loop_over_entries(network, model, points, single):
    root = RootPose(rot.identity(), np.zeros(3))
    rest = SubjectModel(model.subject, network.mean_rotations).markers(np.zeros((JOINTS - 1, 3)))
    frame = root_from_torso(Observation.of_points(points[0]), rest, model, root)
    mean, log_sigma = by_hand(network, model, points, single, frame)
    mean = network.outputs[0] + network.outputs[1] * mean
    sigma = np.hypot(network.spread[0] * network.outputs[1] * np.exp(log_sigma), network.spread[1])
    found = MotionPrior(network, SubjectModel(model.subject, network.mean_rotations), network.mean_rotations).estimate(
        recent(points, single), root
    )
    np.testing.assert_allclose(found.pose.mean, mean[6:], atol=2e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(found.pose.covariance)), sigma[6:], rtol=2e-4)
    np.testing.assert_allclose(found.root.position_m, frame.to_world(mean[3:6]), atol=2e-5)
    turn = rot.multiply(frame.rotation, rot.from_rotation_vector(mean[:3]))
    assert rot.angle_between(found.root.rotation, turn) < 2e-5
    # the same rotations where poses are relative to another mean
    other = MotionPrior(network, model, model.mean_rotations).estimate(recent(points, single), root)
    mine = rot.multiply(model.mean_rotations[1:], rot.from_rotation_vector(other.pose.mean.reshape(-1, 3)))
    theirs = rot.multiply(network.mean_rotations[1:], rot.from_rotation_vector(found.pose.mean.reshape(-1, 3)))
    assert np.max(rot.angle_between(mine, theirs)) < 1e-6


def test_prior_is_independent_of_place_and_heading(network, model, points):
    prior = MotionPrior(network, model, model.mean_rotations)
    root = RootPose(rot.identity(), np.zeros(3))
    one = prior.estimate(recent(points), root)
    turn, shift = rot.from_rotation_vector([0.0, 2.0, 0.0]), np.array([3.0, 0.5, -8.0])
    other = prior.estimate(recent(rot.rotate(turn, points) + shift), root)
    np.testing.assert_allclose(other.pose.mean, one.pose.mean, atol=1e-4)
    np.testing.assert_allclose(other.root.position_m, rot.rotate(turn, one.root.position_m) + shift, atol=1e-4)
    assert rot.angle_between(other.root.rotation, rot.multiply(turn, one.root.rotation)) < 1e-4


def test_jumping_markers_have_no_velocity(network, model, points):
    """A cut: earlier markers metres away count as not seen; absurd ones give numbers all the same."""
    prior, root = MotionPrior(network, model, model.mean_rotations), RootPose(rot.identity(), np.zeros(3))
    points[:, np.isnan(points[0, :, 0])] = np.nan
    cut, alone = points.copy(), points.copy()
    cut[1:] += [30.0, 0.0, 0.0]
    alone[1:] = np.nan
    np.testing.assert_array_equal(
        prior.estimate(recent(cut), root).pose.mean, prior.estimate(recent(alone), root).pose.mean
    )
    for far in (1e3, 1e30):
        absurd = points.copy()
        absurd[0, np.flatnonzero(~model.torso)[0]] = far
        estimate = prior.estimate(recent(absurd), root)
        assert np.all(np.isfinite(estimate.pose.mean)) and np.all(np.isfinite(estimate.pose.covariance))


def test_batched_priors_equal_single_ones(network, model, true_markers):
    frames = [recent(true_markers[[at, at - 1, at - 3, at - 15]].copy()) for at in range(20, 25)]
    frames[2].points_m[0, np.flatnonzero(model.torso)[1:]] = np.nan  # where the body is depends on the frame before
    root, prior = RootPose(rot.identity(), np.zeros(3)), MotionPrior(network, model, model.mean_rotations)
    alone = [prior.estimate(each, root) for each in frames]
    computed, prior._run = [], lambda *given: computed.append(1) or MotionPrior._run(prior, *given)
    together = prior.estimate_all(frames)
    assert together.pop(2) is None
    alone.pop(2)
    for found, expected in zip(together, alone, strict=True):
        np.testing.assert_allclose(found.pose.mean, expected.pose.mean, atol=1e-5)
        np.testing.assert_allclose(found.pose.covariance, expected.pose.covariance, atol=1e-6)
        np.testing.assert_allclose(found.root.position_m, expected.root.position_m, atol=1e-6)
        np.testing.assert_allclose(found.root_sigma, expected.root_sigma, rtol=1e-4)
    assert prior.estimate_all([frames[2]]) == [None]
    assert prior.estimate_all([]) == []
    assert len(computed) == 1


def solved(model, database, markers, **settings):
    solver = PoseSolver(model, database, SolveSettings(best=BestSettings(**settings)))
    state, poses = solver.initial_state, []
    for row in markers:
        solution, state = solver.step(state, Observation.of_points(row))
        poses.append(solution.pose)
    return np.array(poses)


def test_single_camera_markers_are_back_projected_for_the_prior(
    model, database, true_markers, stage_rig, network_file, monkeypatch
):
    asked, estimate = [], MotionPrior.estimate
    monkeypatch.setattr(
        MotionPrior, "estimate", lambda prior, recent, root: asked.append(recent) or estimate(prior, recent, root)
    )
    hidden, camera = np.flatnonzero(~model.torso)[:2], stage_rig.cameras[1]
    solver = PoseSolver(model, database, SolveSettings(best=BestSettings(prior_file=str(network_file))))
    state = solver.initial_state
    for row in true_markers[:3]:
        _, state = solver.step(state, Observation.of_points(row))
    points, cameras, image_points = true_markers[3].copy(), np.full(len(row), -1), np.full((len(row), 2), np.nan)
    for marker in hidden:
        image_points[marker] = camera.undistort(camera.project(points[marker]))
    points[hidden], cameras[hidden] = np.nan, 1
    expected = state.markers_m
    _, state = solver.step(state, Observation(points, cameras, image_points, stage_rig.cameras))
    np.testing.assert_array_equal(asked[-1].single, np.isin(np.arange(len(row)), hidden))
    assert not any(recent.single.any() for recent in asked[:-1])
    for marker in hidden:
        ray, found = camera.rays(image_points[marker]), asked[-1].points_m[0, marker]
        np.testing.assert_allclose(np.cross(found - camera.centre_m, ray), 0.0, atol=1e-9)
        assert (found - expected[marker]) @ ray == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(state.observed.values[-1][hidden]).all()  # no memory of a guess


def test_missing_file_disables_the_prior(model, database, true_markers, tmp_path, network_file):
    markers = true_markers[:8]
    off = solved(model, database, markers, prior_share=0.0)
    missing = solved(model, database, markers, prior_share=1.0, prior_file=str(tmp_path / "none.npz"))
    np.testing.assert_array_equal(off, missing)
    assert np.max(np.abs(solved(model, database, markers, prior_share=1.0, prior_file=str(network_file)) - off)) > 1e-4


def test_damaged_prior_files_are_refused(database, network_file, tmp_path):
    assert open_network(tmp_path / "none.npz") is None
    whole = network_file.read_bytes()
    damaged = tmp_path / "damaged.npz"
    others = (
        {"biases": np.zeros((2, WIDTH), np.float16)}, {"biases": np.full((3, WIDTH), 64.0, np.float16)},
        {"outputs": np.full((2, OUTPUTS), np.nan)}, {"spread": np.array("text")},
        {"facts": np.array(json.dumps({"version": 99}))}, {"facts": np.array("[")}, {"facts": np.array("[]")},
        {"weights": np.zeros(3, np.float16)}, {"more": np.zeros(3)}, {"part_of_joint": np.full(JOINTS, -3)},
        {"output_weights": np.zeros((WIDTH, 2 * OUTPUTS), np.float32)},
    )  # fmt: skip
    for changes in others:
        write_network(damaged, database.mean_rotations, **changes)
        with pytest.raises(FormatError, match="is not a motion prior"):
            open_network(damaged)
    generator = np.random.default_rng(1)
    for content in (b"", b"no archive", whole[:1000], whole[: len(whole) // 2], whole[:-30]):
        damaged.write_bytes(content)
        with pytest.raises(FormatError, match="is not a motion prior"):
            open_network(damaged)
    for _ in range(40):
        changed = bytearray(whole)
        for place in generator.integers(len(whole), size=20):
            changed[place] ^= 255
        damaged.write_bytes(changed)
        with pytest.raises(FormatError, match="is not a motion prior"):
            open_network(damaged)


def test_the_shipped_file_opens_and_is_small():
    assert MOTION_PRIOR.stat().st_size <= 4e6
    assert open_network(MOTION_PRIOR).facts["version"] == VERSION


def test_shipped_prior_names_its_training_data():
    facts = open_network(MOTION_PRIOR).facts
    people = {name for name in facts["subjects"] if name.isdecimal()}
    assert set(facts["subjects"]) - people == {"motion"}  # the embedded clips; no other studio's
    assert people == set(CMU_PEOPLE)
    assert "mocap.cs.cmu.edu" in facts["source"]
    text = (MOTION_PRIOR.parents[1] / "README.md").read_text(encoding="utf-8")
    for words in ("CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu)", "NSF EIA-0196217"):
        assert words in text


def test_a_vague_root_of_the_learned_prior_is_not_used(model, database, true_markers, truth, monkeypatch):
    """Markers like none it was trained on: it says so by large deviations, and the torso markers locate the root."""
    usual = MotionPrior.estimate

    def turned_round(self, *given):
        found = usual(self, *given)
        back = RootPose(rot.multiply(rot.from_rotation_vector([0.0, np.pi, 0.0]), found.root.rotation), np.zeros(3))
        return replace(found, root=back, root_sigma=(0.15, 1.7))

    monkeypatch.setattr(MotionPrior, "estimate", turned_round)
    taller = replace(model.skeleton, offsets_m=1.01 * model.skeleton.offsets_m)  # nobody in the database
    stranger = SubjectModel(replace(model.subject, skeleton=taller), model.mean_rotations)
    solver = PoseSolver(stranger, database, SolveSettings())
    solution, _ = solver.step(solver.initial_state, Observation.of_points(true_markers[30]), 0.5)
    assert np.degrees(rot.angle_between(solution.root.rotation, truth.rotations[30, 0])) < 15.0
