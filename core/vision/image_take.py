"""Marker take of one camera: unnamed trajectories in its image."""

from collections.abc import Sequence

import numpy as np

from ..errors import TakeError
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.marker_take import MarkerTake, SingleViews
from .matching.image_tracks import BlobLinker, image_tracks


def image_take(frames: Sequence[MarkerFrame], rig: CameraRig, name: str, fps: float) -> MarkerTake:
    """Return image trajectories, those that do not overlap in one column.

    Which marker each is, is decided when the take is solved, by the body (see `sources.take.take_frames`).

    Raises:
        TakeError: no frame shows anything.
    """
    linker = BlobLinker(rig.cameras[0].image_size[0])
    times_s = np.array([frame.time_s for frame in frames])
    pixels = [frame.blobs[0][:, :2].astype(np.float64) for frame in frames]
    ids = [linker.link(time_s, blobs) for time_s, blobs in zip(times_s.tolist(), pixels, strict=True)]
    points = image_tracks(
        times_s.tolist(), [undistort_blobs(frame, rig.cameras).normalised[0] for frame in frames], ids
    ).points
    if len(points) == 0:
        raise TakeError("shows no markers", where=name, advice="check the threshold and the light")
    points = np.swapaxes(points, 0, 1)
    cameras = np.where(np.isfinite(points[..., 0]), 0, -1)
    return MarkerTake(
        name,
        fps,
        tuple(f"B{column + 1:02d}" for column in range(points.shape[1])),
        np.full((*cameras.shape, 3), np.nan),
        np.array([frame.number for frame in frames]),
        times_s,
        SingleViews(rig, cameras, points),
    )
