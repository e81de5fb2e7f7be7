"""Camera calibration from videos of a moving board, synchronised or not.

Frames with the same number belong together. The corners' motion shows how late each camera took its pictures, so this
delay is reported and does not spoil the calibration.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...errors import CalibrationError, CaptureError, counted
from ...geometry.arrays import Array, Image
from ...system.progress import Progress
from ..sources.video_source import VideoSource
from .board_quality import with_edge_widths
from .calibrate import CalibrationResult, calibrate_from_points
from .calibration_board import Board, BoardView, find_board, grey_of
from .rig_fit import MINIMUM_VIEWS, CameraViews, Rejected


@dataclass(frozen=True)
class VideoSettings:
    """Settings for choosing frames from a video."""

    searched: int = 240  # number of moments in which the board is searched for
    used: int = 60  # number of moments that are used: those with the least motion
    least_tracked: int = 6  # fewest corners that optical flow must follow


_VIDEO = VideoSettings()


def calibrate_videos(
    videos: Mapping[str, str], board: Board, progress: Progress, *, left_right: bool = True
) -> CalibrationResult:
    """Calibrate cameras from videos of a board.

    Args:
        videos: Video file of each camera, by camera name; all have the same length and rate.
        left_right: Check that the first two are the left and the right camera.

    Raises:
        CalibrationError: A video is unreadable, lengths differ, there are too few views, or the cameras are exchanged.
    """
    try:
        source = VideoSource(list(videos.values()))
        cameras = _watch_videos(list(videos), source, board, progress)
    except CaptureError as error:
        raise CalibrationError(error.what, where=error.where, advice=error.advice) from error
    for camera in cameras:
        if len(camera.views) < MINIMUM_VIEWS:
            raise CalibrationError(
                f"the board was found in only {len(camera.views)} of {min(source.frames, _VIDEO.searched)} searched "
                f"frames, but {MINIMUM_VIEWS} are needed",
                where=f"camera {camera.name}",
                advice="check the size of the board, and that it is in the pictures, sharp and lit",
            )
    progress(0.9, "calibrating")
    chosen, rejected = _stillest(cameras)
    return calibrate_from_points(board.points_m, chosen, rejected, left_right=left_right, ambiguous=board.is_ambiguous)


def _watch_videos(names: Sequence[str], source: VideoSource, board: Board, progress: Progress) -> list[CameraViews]:
    views: dict[str, dict[str, BoardView]] = {name: {} for name in names}
    sizes: dict[str, tuple[int, int]] = {}
    for number, before, now, after in _moments(source):
        progress(0.9 * number / max(source.frames, 1), f"looking for the board: frame {number}")
        for i, name in enumerate(names):
            sizes[name] = (now[i].shape[1], now[i].shape[0])
            view = find_board(now[i], board)
            if view is None:
                continue
            around = [None if images is None else grey_of(images[i]) for images in (before, after)]
            view = replace(view, motion_px_s=_motion(grey_of(now[i]), view, around, source.fps))
            views[name][f"{number:06d}"] = with_edge_widths(view, now[i], board)
    return [CameraViews(name, sizes[name], views[name]) for name in names]


def _moments(
    source: VideoSource,
) -> Iterator[tuple[int, tuple[Image, ...] | None, tuple[Image, ...], tuple[Image, ...] | None]]:
    """Yield the number and the images of each searched moment, with the frames before and after it."""
    step = max(1, source.frames // _VIDEO.searched)
    before: tuple[Image, ...] | None = None
    now: tuple[Image, ...] | None = None
    number = -1
    for image_set in source:
        if now is not None and number % step == 0:
            yield number, before, now, image_set.images
        before, now, number = now, image_set.images, number + 1
    if now is None:
        raise CalibrationError("the videos contain no frames", where=source.name, advice="export them again")
    if number % step == 0:
        yield number, before, now, None


def _motion(now: Image, view: BoardView, around: Sequence[Image | None], fps: float) -> Array | None:
    """Return the velocities (n, 2) of corners from optical flow, pixels per second."""
    moved: list[Array] = []
    for image, sign in zip(around, (-1.0, 1.0), strict=True):
        if image is not None:
            flow = _flow(now, image, view.pixels)
            if flow is not None:
                moved.append(sign * flow)
    return np.mean(moved, axis=0) * fps if moved else None


def _flow(now: Image, other: Image, pixels: Array) -> Array | None:
    start = pixels.astype(np.float32).reshape(-1, 1, 2)
    found, status, _ = cv2.calcOpticalFlowPyrLK(now, other, start, None, maxLevel=5)  # type: ignore[call-overload]
    good = np.asarray(status).ravel() > 0
    if good.sum() < _VIDEO.least_tracked:
        return None
    # the board is planar, so a homography also gives the corners that optical flow lost
    homography, kept = cv2.findHomography(start[good], np.asarray(found)[good], cv2.RANSAC, 2.0)
    if homography is None or np.asarray(kept).sum() < _VIDEO.least_tracked:
        return None
    return np.asarray(cv2.perspectiveTransform(start, homography), np.float64).reshape(-1, 2) - pixels


def _stillest(cameras: Sequence[CameraViews]) -> tuple[list[CameraViews], list[Rejected]]:
    """Choose moments with little motion, spread over the recording."""
    least = min(2, len(cameras))
    shared = sorted(
        key for key in {k for c in cameras for k in c.views} if sum(key in c.views for c in cameras) >= least
    )
    parts = np.array_split(np.array(shared), min(_VIDEO.used, max(len(shared), 1)))
    chosen = {str(min(part, key=lambda key: _speed(cameras, key))) for part in parts if len(part)}
    rejected = []
    if len(chosen) < len(shared):
        rejected = [Rejected(counted(len(shared) - len(chosen), "frame"), "the board moves less in others")]
    return [replace(c, views={k: v for k, v in c.views.items() if k in chosen}) for c in cameras], rejected


def _speed(cameras: Sequence[CameraViews], key: str) -> float:
    motions = [camera.views[key].motion_px_s for camera in cameras if key in camera.views]
    return max(np.inf if m is None else float(np.median(np.linalg.norm(m, axis=1))) for m in motions)
