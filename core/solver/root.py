"""Root position and orientation from the torso markers (z_t, section 6)."""

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rigid_transform import fit_rigid
from .observation import Observation
from .subject_model import RootPose, SubjectModel


def root_from_torso(
    observation: Observation,
    local_markers_m: Array,
    subject: SubjectModel,
    previous: RootPose | None,
) -> RootPose | None:
    """Return the root that best moves the torso markers of a pose onto the observed ones.

    With fewer than three observed torso markers, the previous root is shifted to the markers; without a previous root,
    None is returned.

    Args:
        local_markers_m: Markers (M, 3) of the assumed pose in the root's frame.
        previous: Root of the last frame; None at the start.
    """
    seen = subject.torso & observation.located
    if np.count_nonzero(seen) >= 3:
        return RootPose(*fit_rigid(local_markers_m[seen], observation.points_m[seen], subject.torso_weights[seen]))
    if previous is None:
        return None
    return _moved(previous, observation, local_markers_m)


def _moved(previous: RootPose, observation: Observation, local_markers_m: Array) -> RootPose:
    """Return the previous root shifted to the located markers, with its rotation unchanged."""
    seen = observation.located
    if not np.any(seen):
        return previous
    shift = np.mean(observation.points_m[seen] - previous.to_world(local_markers_m[seen]), axis=0)
    return RootPose(previous.rotation, previous.position_m + shift)
