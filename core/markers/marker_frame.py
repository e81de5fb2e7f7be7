"""Marker frame: the blobs, points and rays of one moment."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..errors import CaptureError, counted
from ..geometry.arrays import Array, FloatArray, IntArray
from ..geometry.camera import Camera, undistort_all


@dataclass(frozen=True)
class MarkerFrame:
    """N points, R rays and the blobs that C cameras show at one moment.

    Labels are indices in the marker set if the source knows them, else -1. If `detected` is empty, `blobs` are as in
    the images; `normalised` is empty until `undistort_blobs` computes it.
    """

    number: int
    time_s: float
    points_m: Array = field(default_factory=lambda: np.empty((0, 3)))  # (N, 3) triangulated, in the world
    covariances_m2: Array = field(default_factory=lambda: np.empty((0, 3, 3)))  # (N, 3, 3)
    labels: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    # per camera (n, 5): x, y (pixels, distorted), radius_px, brightness 0-255, hue 0-180
    blobs: tuple[FloatArray, ...] = ()
    detected: tuple[FloatArray, ...] = ()  # blobs as in the images, if `blobs` were moved to another time
    normalised: tuple[Array, ...] = ()  # per camera (n, 2) undistorted normalised coordinates of the blobs
    point_blobs: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))  # (N, C), -1 for none
    single_cameras: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # (R,) camera of a ray
    single_blobs: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # (R,) its blob in that camera
    single_points: Array = field(default_factory=lambda: np.empty((0, 2)))  # (R,) normalised coordinates of the blob
    single_labels: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    camera_times_s: Array = field(default_factory=lambda: np.empty(0))  # (C,) stamps of the images, NaN if none
    notes: tuple[str, ...] = ()  # problems of the source in plain words ("left camera frozen")

    def __post_init__(self) -> None:
        points, rays, cameras = len(self.points_m), len(self.single_cameras), len(self.blobs)
        if len(self.detected) == 0:
            object.__setattr__(self, "detected", self.blobs)
        if len(self.detected) != cameras:
            raise CaptureError(
                f"has detected blobs of {counted(len(self.detected), 'camera')}, but blobs of {cameras}",
                where=f"frame {self.number}",
                advice="give both for every camera",
            )
        if self.normalised and [len(rows) for rows in self.normalised] != [len(rows) for rows in self.blobs]:
            raise CaptureError(
                "the normalised coordinates do not match the blobs",
                where=f"frame {self.number}",
                advice="give one pair for each blob",
            )
        if len(self.labels) == 0 and points:
            object.__setattr__(self, "labels", np.full(points, -1, dtype=np.int64))
        if len(self.single_labels) == 0 and rays:
            object.__setattr__(self, "single_labels", np.full(rays, -1, dtype=np.int64))
        if self.point_blobs.size == 0:
            object.__setattr__(self, "point_blobs", np.full((points, cameras), -1, dtype=np.int64))
        if len(self.camera_times_s) == 0:
            object.__setattr__(self, "camera_times_s", np.full(cameras, self.time_s))
        expected = {
            "points_m": (points, 3),
            "covariances_m2": (points, 3, 3),
            "labels": (points,),
            "point_blobs": (points, cameras),
            "single_blobs": (rays,),
            "single_points": (rays, 2),
            "single_labels": (rays,),
            "camera_times_s": (cameras,),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise CaptureError(
                    f"{name} has shape {getattr(self, name).shape}, not {shape}",
                    where=f"frame {self.number}",
                    advice="give one row for each point, ray or camera",
                )

    @cached_property
    def is_labelled(self) -> bool:
        """Whether the source labelled its markers."""
        return bool(np.any(self.labels >= 0) or np.any(self.single_labels >= 0))


def undistort_blobs(frame: MarkerFrame, cameras: Sequence[Camera]) -> MarkerFrame:
    """Return the frame with normalised coordinates, computed if they are missing."""
    if frame.normalised or not frame.blobs or len(frame.blobs) != len(cameras):
        return frame
    pixels = [blobs[:, :2].astype(np.float64) for blobs in frame.blobs]
    return replace(frame, normalised=tuple(undistort_all(cameras, pixels)))
