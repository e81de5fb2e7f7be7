"""How well located points explain the images."""

from collections.abc import Sequence

import numpy as np

from ..geometry.arrays import IntArray
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame


def labelled_rms_px(rig: CameraRig, frames: Sequence[MarkerFrame], labels: Sequence[IntArray]) -> float:
    """Return the RMS distance in pixels of blobs to projections of labelled points.

    Both directions of a pixel count as one distance; NaN when there is no labelled point.
    """
    squares = []
    for frame, row in zip(frames, labels, strict=True):
        for index, camera in enumerate(rig.cameras):
            used = (row >= 0) & (frame.point_blobs[:, index] >= 0)
            if used.any():
                seen = frame.blobs[index][frame.point_blobs[used, index], :2]
                squares.append(np.sum((camera.project(frame.points_m[used]) - seen) ** 2, axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float("nan")
