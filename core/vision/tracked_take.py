"""Processing of a complete take: synchronisation, triangulation, reprojection errors, and takes of a single camera."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import TakeError, counted
from ..geometry.arrays import IntArray
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.marker_set import load_marker_set
from ..markers.marker_take import MarkerTake, SingleViews
from .matching.image_tracks import BlobLinker, image_tracks
from .matching.time_alignment import TimeAligner
from .matching.time_offset import TimeOffset, estimate_time_offsets
from .people.body_network import BlazePose
from .people.people_pipeline import PersonLocator
from .pipeline import MarkerPipeline


def synchronise_frames(
    rig: CameraRig, frames: Sequence[MarkerFrame]
) -> tuple[list[MarkerFrame], tuple[TimeOffset, ...]]:
    """Return frames with blobs moved to one time and triangulated again, and the time offsets.

    If no offset is certain, the frames are returned unchanged.
    """
    offsets = estimate_time_offsets(rig, frames, largest_s=0.25)
    if not any(offset.is_certain for offset in offsets):
        return list(frames), offsets
    pipeline = MarkerPipeline(rig)
    pipeline.aligner = TimeAligner(rig, [offset if offset.is_certain else TimeOffset() for offset in offsets])
    return [pipeline.locate(frame) for frame in frames], offsets


def check_cameras(rig: CameraRig, frames: Sequence[MarkerFrame]) -> None:
    """Raise TakeError if the frames come from a different number of cameras."""
    for frame in frames:
        if len(frame.detected) != len(rig):
            raise TakeError(
                f"was recorded by {counted(len(frame.detected), 'camera')}, but the calibration has {len(rig)}",
                where=f"frame {frame.number}",
                advice="give a calibration of the same cameras",
            )


def retriangulate(rig: CameraRig, frames: Sequence[MarkerFrame]) -> list[MarkerFrame]:
    """Return synchronised frames of this rig's cameras with points triangulated again from the detected blobs."""
    pipeline = MarkerPipeline(rig)
    located = [pipeline.locate(replace(frame, blobs=frame.detected, normalised=())) for frame in frames]
    return synchronise_frames(rig, located)[0]


def relocate(rig: CameraRig, frames: Sequence[MarkerFrame]) -> list[MarkerFrame]:
    """Return the frames of a person without markers with the points located again from those in the pictures."""
    return PersonLocator(rig, load_marker_set(BlazePose.marker_set)).locate_all(frames)


def labelled_rms_px(rig: CameraRig, frames: Sequence[MarkerFrame], labels: Sequence[IntArray]) -> float:
    """Return the RMS reprojection error of labelled points, pixels; NaN if there are none."""
    squares = []
    for frame, row in zip(frames, labels, strict=True):
        for index, camera in enumerate(rig.cameras):
            used = (row >= 0) & (frame.point_blobs[:, index] >= 0)
            if used.any():
                seen = frame.blobs[index][frame.point_blobs[used, index], :2]
                squares.append(np.sum((camera.project(frame.points_m[used]) - seen) ** 2, axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float("nan")


def image_take(frames: Sequence[MarkerFrame], rig: CameraRig, name: str, fps: float) -> MarkerTake:
    """Return a take with one camera's image trajectories; those that do not overlap in time share a column.

    They are labelled when the take is solved (see `markers.take_frames`).

    Raises:
        TakeError: No frame shows anything.
    """
    linker = BlobLinker(rig.cameras[0].image_size[0])
    times_s = np.array([frame.time_s for frame in frames])
    pixels = [frame.blobs[0][:, :2].astype(np.float64) for frame in frames]
    ids = [linker.link(time_s, blobs) for time_s, blobs in zip(times_s.tolist(), pixels, strict=True)]
    normalised = [undistort_blobs(frame, rig.cameras).normalised[0] for frame in frames]
    points = np.swapaxes(image_tracks(times_s.tolist(), normalised, ids).points, 0, 1)
    if points.shape[1] == 0:
        raise TakeError("shows no markers", where=name, advice="check the threshold and the light")
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


def labelled_take(
    frames: Sequence[MarkerFrame], names: Sequence[str], name: str, fps: float, rig: CameraRig
) -> MarkerTake:
    """Return a take with the points that their source has labelled, and those that a single camera shows."""
    positions_m = np.full((len(frames), len(names), 3), np.nan)
    cameras, points = np.full(positions_m.shape[:2], -1), np.full((*positions_m.shape[:2], 2), np.nan)
    for row, frame in enumerate(frames):
        positions_m[row, frame.labels] = frame.points_m
        cameras[row, frame.single_labels] = frame.single_cameras
        points[row, frame.single_labels] = frame.single_points
    return MarkerTake(
        name,
        fps,
        tuple(names),
        positions_m,
        np.array([frame.number for frame in frames]),
        np.array([frame.time_s for frame in frames]),
        SingleViews(rig, cameras, points),
    )
