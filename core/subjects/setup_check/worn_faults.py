"""Faults that a performer in a T pose reveals: a missing marker, a wrong scale."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...body.calibration_poses import t_pose
from ...body.skeleton import marker_positions
from ...body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from ...geometry.arrays import Array, Mask
from ...geometry.camera import CameraRig
from ...geometry.rigid_transform import kabsch
from ...labelling.template_labelling import label_by_template
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from .finding import Fault, Finding


@dataclass(frozen=True)
class TPoseSettings:
    """Settings for the faults that a T pose reveals."""

    sizes: tuple[float, ...] = (1.0, 0.5, 0.63, 0.8, 1.25, 1.6, 2.0)  # scales of the world to try
    like_pose_m: float = 0.05  # largest RMS distance of the markers from a T pose
    searched: int = 16  # number of moments searched
    fewest_markers: int = 4
    fewest_moments: int = 3
    never: float = 0.2  # largest share of the moments in which a missing marker may appear
    near_px: float = 25.0  # largest distance of a blob from an expected marker that it may be
    known_scale: float = 0.10  # largest deviation of the scale if the performer's height is known
    unknown_scale: float = 0.22  # largest deviation of the scale if the height is unknown


SETTINGS = TPoseSettings()


@dataclass(frozen=True)
class TPose:
    """A performer recognised in a T pose.

    Args:
        size: Scale of the performer in this world; 1 if the world's scale is correct.
        labelled: Mask (M,) of the markers that were found among the points.
        markers_m: Expected positions (M, 3) of the markers in world axes.
    """

    size: float
    labelled: Mask
    markers_m: Array


def find_t_poses(
    frames: Sequence[MarkerFrame], marker_set: MarkerSet, height_m: float | None
) -> list[tuple[MarkerFrame, TPose]]:
    """Return moments with a recognised T pose, spread over the frames."""
    skeleton = default_skeleton(height_m or DEFAULT_HEIGHT_M)
    joints = marker_set.joint_indices(skeleton)
    template = marker_positions(skeleton, joints, marker_set.offsets_m, t_pose(skeleton), np.zeros(3))
    chosen = frames[:: max(len(frames) // SETTINGS.searched, 1)]
    best: list[tuple[MarkerFrame, TPose]] = []
    for size in SETTINGS.sizes:
        found = [(frame, pose) for frame in chosen if (pose := _recognise(frame.points_m, template, size)) is not None]
        if _count(found) > _count(best):
            best = found
        if sum(int(pose.labelled.sum()) >= len(template) - 1 for _, pose in best) >= SETTINGS.fewest_moments:
            break
    return best


def _count(poses: Sequence[tuple[MarkerFrame, TPose]]) -> int:
    return sum(int(pose.labelled.sum()) for _, pose in poses)


def _recognise(points_m: Array, template_m: Array, size: float) -> TPose | None:
    """Return the T pose that points show in a world of about the given scale; None if they show another pose."""
    labels = label_by_template(points_m / size, template_m)
    known = np.flatnonzero(labels >= 0)
    if len(known) < SETTINGS.fewest_markers:
        return None
    source, target = template_m[labels[known]], points_m[known]
    turn, _ = kabsch(source, target)
    centred = (source - source.mean(axis=0)) @ turn.T
    scale = float(np.sum(centred * target) / np.sum(centred**2))
    shift = target.mean(axis=0) - scale * turn @ source.mean(axis=0)
    expected = scale * template_m @ turn.T + shift
    rms_m = float(np.sqrt(np.mean(np.sum((target - expected[labels[known]]) ** 2, axis=1))))
    if rms_m > SETTINGS.like_pose_m * scale:
        return None
    return TPose(scale, np.isin(np.arange(len(template_m)), labels), expected)


def scale_fault(poses: Sequence[tuple[MarkerFrame, TPose]], height_m: float | None) -> list[Finding]:
    """Return a finding if the world's scale does not fit the performer's height."""
    if len(poses) < SETTINGS.fewest_moments:
        return []
    size = float(np.median([pose.size for _, pose in poses]))
    most = 1.0 + (SETTINGS.unknown_scale if height_m is None else SETTINGS.known_scale)
    if 1.0 / most <= size <= most:
        return []
    seems, what = size * (height_m or DEFAULT_HEIGHT_M), "larger" if size < 1.0 else "smaller"
    text = f"the size of the board's squares is wrong: by the cameras the performer is {seems:.2f} m tall"
    text += f"; measure a square, it is {what} by a factor of {max(size, 1.0 / size):.2f}, and calibrate again"
    return [Finding(Fault.SQUARE_SIZE, "", text)]


def missing_fault(rig: CameraRig, poses: Sequence[tuple[MarkerFrame, TPose]], marker_set: MarkerSet) -> list[Finding]:
    """Return a finding on the markers of the set that no camera sees."""
    if len(poses) < SETTINGS.fewest_moments:
        return []
    seen = np.mean([pose.labelled | _has_blob(rig, frame, pose) for frame, pose in poses], axis=0)
    missing = [text for text, share in zip(marker_set.texts, seen, strict=True) if share <= SETTINGS.never]
    if not missing:
        return []
    worn = "a marker is" if len(missing) == 1 else f"{len(missing)} markers are"
    text = f"{worn} not seen: {', '.join(missing)}; put it on, or clean it, or choose another marker set"
    return [Finding(Fault.MARKER_MISSING, "", text)]


def _has_blob(rig: CameraRig, frame: MarkerFrame, pose: TPose) -> Mask:
    """Return a mask (M,) of the markers with a blob near their expected position that belongs to no point."""
    found = np.zeros(len(pose.markers_m), dtype=bool)
    for camera, view in enumerate(rig.cameras):
        free = np.setdiff1d(np.arange(len(frame.blobs[camera])), frame.point_blobs[:, camera])
        if len(free):
            expected = view.project(pose.markers_m)
            distance = np.linalg.norm(expected[:, None] - frame.blobs[camera][free, :2], axis=2).min(axis=1)
            found |= distance < SETTINGS.near_px
    return found
