"""Calibration of cameras and performers, for commands and scripts."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..body.standard_skeleton import default_skeleton
from ..database.store import Database
from ..errors import SettingsError, SubjectError
from ..labelling.human_size import likely_height_m
from ..labelling.take_import import import_take
from ..markers.label_faults import correct_labels
from ..markers.label_matching import AUTO
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import is_of_one_camera, is_unnamed
from ..subjects import pose_calibration
from ..subjects.from_motion import fitted_body, subject_from_motion
from ..subjects.pose_calibration import SubjectCalibration, calibrate_markers, calibration_points, pose_points
from ..subjects.prototype_bodies import load_bodies
from ..subjects.unknown_marker_placement import place_markers, with_usual_offsets
from ..system.files import is_file
from ..system.progress import Progress, no_progress
from .take_reading import choose_worn

if TYPE_CHECKING:
    from ..vision.calibration.calibrate import CalibrationResult


def calibrate_cameras(
    sources: Mapping[str, Path | str],
    board: str,
    progress: Progress = no_progress,
    *,
    left_right: bool = False,
) -> "CalibrationResult":
    """Calibrate cameras from pictures of a board; return their intrinsics and poses, and how accurate these are.

    Args:
        sources: Pictures of the board by camera name: folders or patterns of images, or videos.
        board: `chessboard:9x6:24.23mm` (inner corners, square size) or `charuco:7x5:40mm:30mm:DICT_4X4_50`.
        progress: Called with the fraction done and the activity.
        left_right: Raise an error if the first camera is to the right of the second.

    Raises:
        SettingsError: Videos and pictures are mixed, or the board's description is invalid.
        CalibrationError: The board was found too rarely, or the pictures do not determine the cameras.
    """
    from ..vision.calibration.calibrate_images import calibrate_images  # OpenCV is slow to load
    from ..vision.calibration.calibrate_videos import calibrate_videos
    from ..vision.calibration.calibration_board import parse_board
    from ..vision.sources.image_file_source import is_image_pattern

    patterns = {name: str(source) for name, source in sources.items()}
    videos = [name for name, pattern in patterns.items() if is_file(pattern) and not is_image_pattern(pattern)]
    if videos and len(videos) < len(patterns):
        still = next(name for name in patterns if name not in videos)
        advice = "give a video for every camera, or pictures for every camera"
        raise SettingsError(f"{videos[0]} is a video, but {still} is not", advice=advice)
    calibrate = calibrate_videos if videos else calibrate_images
    return calibrate(patterns, parse_board(board), progress, left_right=left_right)


def calibrate_subject(
    take: MarkerTake,
    marker_set: MarkerSet | Path | str = AUTO,
    poses: str | Sequence[str] = "t",
    name: str = "performer",
    seconds: float = 1.0,
    known: Subject | None = None,
) -> SubjectCalibration:
    """Return the skeleton and marker offsets of a performer who holds calibration poses.

    Args:
        take: Take that shows the poses, see `solve`.
        marker_set: Marker set that was worn, see `load_take`.
        poses: One pose, held when the performer first stands still; or several, each found wherever it is held.
        name: Name of the performer.
        seconds: Time for which each pose is held, s, above 0.
        known: Performer whose bones are kept, so that only the markers are measured.

    Raises:
        SubjectError: A pose is not held, or too few markers are seen.
        TakeError: The body's size is not human, so the unit of length is wrong.
    """
    worn = choose_worn(marker_set, take)
    take = import_take(take, worn, "auto")
    take, _ = correct_labels(take, Subject(name, known.skeleton if known else default_skeleton(), worn))
    held = (poses,) if isinstance(poses, str) else tuple(poses)
    if isinstance(poses, str):
        points_m = calibration_points(take, worn, seconds)
    else:
        points_m = pose_points(take, worn, held, seconds)
    if known is not None:
        return calibrate_markers(points_m, worn, known, name, *held)
    return pose_calibration.calibrate_subject(points_m, worn, load_bodies(), name, *held)


def fit_subject(
    take: MarkerTake,
    database: Database,
    marker_set: MarkerSet | Path | str = AUTO,
    height_m: float | None = None,
    name: str = "performer",
    progress: Progress = no_progress,
) -> Subject:
    """Return the skeleton and marker offsets of a performer from motion alone, without held poses.

    Args:
        take: Take, see `solve`; of a long take, only stretches spread over its length are used.
        database: Motion database that contains similar motion.
        marker_set: Marker set that was worn, see `load_take`; its usual offsets guide the fit. With "auto", markers
            unknown to the set are placed from the motion.
        height_m: Rough body height, 1 to 2.5 m; None to estimate it from the distances between markers. A performer
            whom a single camera saw gets average proportions at this height.
        name: Name of the performer.
        progress: Called with the fraction done and the activity.

    Raises:
        SubjectError: The fit explains too few frames.
        TakeError: The take lacks torso markers, or the body's size is not human.
    """
    worn = choose_worn(marker_set, take)
    take = import_take(take, worn, "auto")
    start = Subject(name, default_skeleton(height_m or likely_height_m(take, worn)), worn)
    if not is_unnamed(take):
        if is_of_one_camera(take):  # guessed depths do not show the proportions
            return start
        take, _ = correct_labels(take, start)
    if marker_set == AUTO and not set(take.names) <= set(worn.names):
        with contextlib.suppress(SubjectError):  # otherwise unknown markers would adapt to a body of the wrong size
            start = fitted_body(take, start, database, progress)
        start = with_usual_offsets(place_markers(take, start, database, progress), take.names)
    return subject_from_motion(take, start, database, progress)
