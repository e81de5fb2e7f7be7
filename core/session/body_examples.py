"""Markers of many poses, for labelling without history."""

import numpy as np

from ..body.calibration_poses import standing, t_pose
from ..body.skeleton import marker_positions
from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray
from ..solver.subject_model import SubjectModel

_EXAMPLES = 2048  # number of database poses


class BodyExamples:
    """Markers in many poses, for labelling without history.

    Attributes:
        start_poses_m: Markers (M, 3) in the T pose and in a standing pose.
        markers_m: Markers (E, M, 3) in many poses with the root at rest.
        ups: Up direction (E, 3) of these poses in the root's frame.
    """

    def __init__(self, model: SubjectModel, database: Database) -> None:
        self.start_poses_m = [rest_markers(model, pose(model.skeleton)) for pose in (t_pose, standing)]
        frames = np.unique(np.linspace(0, database.frames - 1, _EXAMPLES).astype(np.int64))
        upright = np.array([0.0, 1.0, 0.0])
        ups = rot.vertical_in(database.root_rotations[frames])
        markers = np.concatenate((model.database_markers(database, frames), self.start_poses_m))
        self.markers_m: FloatArray = markers.astype(np.float32)
        self.ups: FloatArray = np.concatenate((ups, [upright, upright])).astype(np.float32)


def rest_markers(model: SubjectModel, rotations: Array) -> Array:
    """Return the markers (M, 3) for joint rotations (J, 4) with the root at the origin."""
    return marker_positions(model.skeleton, model.joints, model.offsets_m, rotations, np.zeros(3))
