import numpy as np
import pytest
from perfanim.core.body.skeleton import Skeleton, marker_positions
from perfanim.core.database.store import pose_from_rotations
from perfanim.core.errors import SubjectError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.subject import Subject
from perfanim.core.solver.subject_model import RootPose, SubjectModel

STEP = 1e-6


def random_root(seed: int) -> RootPose:
    generator = np.random.default_rng(seed)
    return RootPose(rot.from_rotation_vector(generator.normal(size=3)), generator.normal(size=3))


def test_root_frame_and_world_are_inverse():
    root, points = random_root(0), np.random.default_rng(1).normal(size=(5, 4, 3))
    np.testing.assert_allclose(root.to_world(root.to_root_frame(points)), points, atol=1e-12)
    np.testing.assert_allclose(root.to_world(np.zeros(3)), root.position_m)


@pytest.mark.parametrize("scale", [0.0, 1e-5, 0.4, 1.2])
def test_jacobian_is_the_derivative_of_the_markers(model, scale):
    generator = np.random.default_rng(2)
    pose, root = generator.normal(scale=scale, size=(28, 3)) if scale else np.zeros((28, 3)), random_root(3)

    def markers(change):
        turned = rot.multiply(root.rotation, rot.from_rotation_vector(change[3:6]))
        return model.markers(pose + change[6:].reshape(28, 3), RootPose(turned, root.position_m + change[:3]))

    found, jacobian = model.markers_and_jacobian(pose, root)
    np.testing.assert_allclose(found, markers(np.zeros(90)), atol=1e-12)
    expected = np.stack([(markers(c) - markers(-c)) / (2.0 * STEP) for c in STEP * np.eye(90)], axis=-1)
    # rounding of 1e-16 over the step; the second-order error is smaller
    np.testing.assert_allclose(jacobian, expected, atol=2e-9)


def test_markers_of_rotations(model, truth, true_markers, database):
    pose = pose_from_rotations(truth.rotations[7], database.mean_rotations)
    root = RootPose(truth.rotations[7, 0], truth.root_positions_m[7])
    assert rot.angle_between(model.rotations(pose, root), truth.rotations[7]).max() < 1e-7
    np.testing.assert_allclose(model.markers(pose, root), true_markers[7], atol=1e-9)


def test_database_markers_are_the_subjects_with_the_root_at_rest(model, database):
    frames = np.array([0, 17, database.frames - 1])
    local = database.local_rotations(frames)
    local[:, 0] = rot.identity()
    expected = marker_positions(model.skeleton, model.joints, model.offsets_m, local, np.zeros((3, 3)))
    np.testing.assert_allclose(model.database_markers(database, frames), expected, atol=1e-6)
    assert model.database_markers(database).shape == (database.frames, 8, 3)


def test_other_skeletons_are_refused(subject, database):
    skeleton = subject.skeleton
    names = tuple("lpollex" if name == "lthumb" else name for name in skeleton.names)
    other = Skeleton(names, skeleton.parents, skeleton.offsets_m, skeleton.tips_m)
    with pytest.raises(SubjectError, match="lacks the standard skeleton's joints; calibrate the subject"):
        SubjectModel(Subject("a", other, subject.marker_set), database.mean_rotations)


def test_joints_with_only_hidden_markers_are_hidden(model):
    names, markers = model.skeleton.names, model.subject.marker_set.markers
    arm = {"lclavicle", "lhumerus", "lradius", "lwrist", "lhand"}
    seen = np.array([marker.joint not in arm for marker in markers])
    assert not seen.all()
    hidden = {name for name, is_hidden in zip(names[1:], model.hidden_joints(seen), strict=True) if is_hidden}
    moved = {names[joint] for marker in markers if marker.joint in arm
             for joint in np.flatnonzero(model.skeleton.is_ancestor[names.index(marker.joint)])}  # fmt: skip
    assert hidden == moved & arm
    assert not model.hidden_joints(np.ones(len(markers), dtype=bool)).any()
