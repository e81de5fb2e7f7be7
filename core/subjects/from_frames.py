"""A subject from unlabelled marker frames of the calibration pose."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..body.calibration_poses import POSES
from ..body.skeleton import Skeleton, marker_positions
from ..body.standard_skeleton import default_skeleton
from ..errors import SubjectError
from ..labelling.template_labelling import label_by_template
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet
from .pose_calibration import SubjectCalibration, calibrate_subject

Array = NDArray[np.float64]

_FEWEST_FRAMES = 5
_STILL_M = 0.05  # spread of a marker over the pose, above which it was not held


def subject_from_frames(
    frames: Sequence[MarkerFrame], marker_set: MarkerSet, prototypes: Sequence[Skeleton], name: str, pose: str = "t"
) -> SubjectCalibration:
    """Return the subject who holds the calibration pose during the frames.

    Args:
        frames: marker frames with located points.
        marker_set: worn markers with their usual offsets.
        prototypes: bodies of many sizes.
        name: of the person.
        pose: one of `POSES`.

    Raises:
        SubjectError: an unknown pose, or the markers were not recognised, not seen, or moved.
    """
    if pose not in POSES:
        raise SubjectError(f"there is no calibration pose {pose!r}", advice="poses: " + ", ".join(POSES))
    skeleton = default_skeleton()
    joints = marker_set.joint_indices(skeleton)
    template = marker_positions(skeleton, joints, marker_set.offsets_m, POSES[pose](skeleton), np.zeros(3))
    found = np.full((len(frames), len(marker_set), 3), np.nan)
    for row, frame in zip(found, frames, strict=True):
        labels = label_by_template(frame.points_m, template)
        row[labels[labels >= 0]] = frame.points_m[labels >= 0]
    seen = np.all(np.isfinite(found), axis=-1)
    if np.sum(np.any(seen, axis=1)) < min(_FEWEST_FRAMES, len(frames)) or len(frames) == 0:
        counts = sorted(len(frame.points_m) for frame in frames) or [0]
        raise SubjectError(
            f"the calibration pose was not recognised: {counts[len(counts) // 2]} points were seen for the "
            f"{len(marker_set)} markers of the set {marker_set.name!r}",
            where=name,
            advice="face the cameras with all markers visible, hold the pose, and check the marker set",
        )
    points = np.full((len(marker_set), 3), np.nan)
    for marker in np.flatnonzero(seen.any(axis=0)):
        track = found[seen[:, marker], marker]
        points[marker] = np.median(track, axis=0)
        if np.median(np.linalg.norm(track - points[marker], axis=1)) > _STILL_M:
            raise SubjectError(
                f"{marker_set.names[marker]} moved during the calibration pose", where=name, advice="hold it still"
            )
    return calibrate_subject(points, marker_set, prototypes, name, pose)
