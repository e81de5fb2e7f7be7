"""Faults in the positions of cameras and performer."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ...errors import CalibrationError
from ...geometry.arrays import Array
from ...geometry.camera import CameraRig
from ...markers.marker_frame import MarkerFrame
from ...vision.calibration.rig_refinement import refine_rig
from ...vision.common_space import CommonSpace, common_space
from ...vision.matching.camera_swap import ImageMismatch
from .finding import Fault, Finding

# A camera that turned almost along the epipolar lines causes little error, but correcting the rig removes nearly all of
# it. So a bump is clear above this error in pixels and this ratio of the errors before and after correction.
_CLEAR = (0.4, 6.0)
_SHARES = (0.2, 0.05)  # share of moments that reveals exchanged images, and flipped ones


def mismatch_fault(mismatches: Sequence[ImageMismatch | None]) -> list[Finding]:
    """Return a finding if the images seem exchanged, mirrored or upside down in many moments."""
    for mismatch, noted in Counter(each for each in mismatches if each is not None).most_common():
        # each moment is tested for one kind of flip only, so a smaller share is enough
        if noted < (_SHARES[0] if mismatch.is_exchange else _SHARES[1]) * len(mismatches):
            continue
        if mismatch.is_exchange:
            advice = "swap their device numbers or files, or calibrate again"
            return [Finding(Fault.EXCHANGED, "", f"{mismatch.note}: {advice}")]
        advice = "switch that off in the camera or its program, or turn the video back"
        return [Finding(Fault.FLIPPED, "", f"{mismatch.note}: {advice}")]
    return []


def bump_fault(rig: CameraRig, frames: Sequence[MarkerFrame]) -> list[Finding]:
    """Return a finding if a camera has moved since it was calibrated."""
    try:
        found = refine_rig(rig, [frame.blobs for frame in frames])
    except CalibrationError:
        return []  # too few markers to decide
    clear = found.before_px > max(_CLEAR[0], _CLEAR[1] * found.after_px)
    if not (found.bumped or clear):
        return []
    text = f"a camera was moved since the calibration: markers miss each other by {found.before_px:.1f} pixels"
    return [Finding(Fault.BUMPED, "", f"{text}; calibrate the cameras again")]


def place_fault(rig: CameraRig, torso_m: Array, height_m: float) -> list[Finding]:
    """Return a finding if the performer is cut off by the image's edge, or the markers look too small.

    Args:
        rig: Cameras in a world with the floor at y = 0.
        torso_m: Centre (3,) of the torso.
    """
    space = common_space(rig, height_m)
    nearest, farthest = _depths_m(space, rig, float(torso_m[0]))
    depth_m = _depth_m(rig, torso_m)
    if nearest is None:
        return []
    if depth_m < nearest:
        text = f"you are too close: the cameras cut off head or feet; step back by {nearest - depth_m:.1f} m"
        return [Finding(Fault.CLOSE, "", text)]
    if depth_m > farthest:
        text = f"you are too far away: markers are too small; come {depth_m - farthest:.1f} m nearer"
        return [Finding(Fault.FAR, "", text)]
    return []


def _depths_m(space: CommonSpace, rig: CameraRig, x_m: float) -> tuple[float | None, float]:
    """Return the smallest and largest distance at which the cameras see a performer near x; None if they never do."""
    columns = np.flatnonzero(space.seen.any(axis=0))
    if not len(columns):
        return None, 0.0
    column = columns[np.argmin(np.abs(space.x_m[columns] - x_m))]
    z_m = space.z_m[space.seen[:, column]]
    depths = [_depth_m(rig, np.array([space.x_m[column], 0.0, z])) for z in (z_m[0], z_m[-1])]
    return min(depths), max(depths)


def _depth_m(rig: CameraRig, point_m: Array) -> float:
    """Return the horizontal distance of a point from the midpoint of the cameras."""
    middle = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    return float(np.hypot(*(point_m - middle)[[0, 2]]))
