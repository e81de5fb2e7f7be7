"""`perfanim track`: images of calibrated cameras to labelled marker trajectories."""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SettingsError

Progress = Callable[[float, str], None]

_BACKGROUND_SAMPLES = 31
_EMPTY_SAMPLES = 240  # of frames without the performer


def add_parser(subparsers: Any) -> None:
    """Add the `track` command."""
    parser = subparsers.add_parser("track", help="images to marker trajectories")
    parser.add_argument("--cameras", metavar="cameras.toml", required=True, help="calibration (anipose-style TOML)")
    source = "a video, a folder or pattern of images, a device number, a stream address"
    parser.add_argument("--left", metavar="SRC", help=source + "; alone: one camera, with more markers")
    parser.add_argument("--right", metavar="SRC", help="the same for the right camera")
    parser.add_argument(
        "--camera",
        metavar="[NAME=]SRC",
        action="append",
        default=[],
        help="any further camera, in the calibration's order; or with its name there, of which others may be left out",
    )
    parser.add_argument("--out", metavar="TAKE", required=True, help="take to write: .take.npz, .trc, .csv or .c3d")
    parser.add_argument("--marker-set", metavar="NAME_OR_FILE", help="names the markers (default: M01, M02, ...)")
    parser.add_argument(
        "--markers",
        metavar="N",
        type=int,
        help="markers worn (default: the set's, or as many as are seen at most times)",
    )
    parser.add_argument(
        "--background", metavar="SRC", nargs="+", help="frames without the performer, one source per camera "
        "(default: learned from the take itself)"
    )  # fmt: skip
    parser.add_argument(
        "--threshold", metavar="LEVELS", type=float, help="grey levels above the background (default: automatic)"
    )
    parser.add_argument("--fps", metavar="RATE", type=float, help="frames per second, where the source does not tell")
    parser.add_argument("--seconds", metavar="S", type=float, help="stop after so many seconds (needed for cameras)")
    parser.add_argument(
        "--no-time-offset",
        action="store_true",
        help="take images of one number as of one moment (default: where the motion shows that a camera is late, its "
        "markers are brought to the time of the others)",
    )
    parser.add_argument(
        "--ignore-distortion",
        action="store_true",
        help="leave the lens distortion out, to compare with results of programs that do (default: corrected)",
    )
    parser.add_argument(
        "--truth", metavar="TAKE", help="trajectories to compare with, frame by frame (.trc, .c3d, .csv, .take.npz)"
    )
    parser.add_argument(
        "--floor",
        choices=("camera", "feet"),
        default="camera",
        help="the take's world: the left camera's level (camera), or with the floor where the feet stand at y = 0 "
        "(feet; needs --marker-set with markers on the feet) (default camera)",
    )
    parser.add_argument(
        "--floor-cameras", metavar="FILE", help="with --floor feet: also write the calibration in that world"
    )
    parser.set_defaults(run=run, wrong_usage=parser.error)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Track, write the take, return the summary."""
    from ..formats.markers.marker_files import write_take
    from ..geometry.rig_file import load_rig
    from ..markers.marker_set import load_marker_set
    from ..vision.sources.spec import open_image_source

    marker_set = load_marker_set(args.marker_set) if args.marker_set else None
    _check(args)
    rig, sources = _in_use(args, load_rig(args.cameras))
    if args.ignore_distortion:
        rig = _without_distortion(rig)
    size = rig.cameras[0].image_size
    source = open_image_source(*sources, fps=args.fps, size=size)
    try:
        pipeline = _pipeline(args, rig, source, progress)
        frames, seconds = _process(args, pipeline, source, progress)
    finally:
        source.close()
    count = len(marker_set) if marker_set else args.markers
    if len(rig) == 1:
        take, found = _of_one_camera(args, rig, frames, source.fps, count)
    else:
        take, found = _of_cameras(args, rig, frames, source.fps, marker_set, pipeline.settings, progress)
    summary = found | {
        "frames": take.frames,
        "lost_frames": int(take.frame_numbers[-1] - take.frame_numbers[0]) + 1 - take.frames,
        "names": list(take.names),
        "frames_per_s": len(frames) / max(seconds, 1e-9),
        "warnings": [*getattr(source, "warnings", ()), *dict.fromkeys(note for f in frames for note in f.notes)],
        "out": str(args.out),
    }
    if args.truth:
        summary |= _compared(take, args.truth)
    write_take(_on_floor(args, take, rig) if args.floor == "feet" else take, args.out)
    return summary


def _of_cameras(
    args: argparse.Namespace,
    rig: Any,
    frames: list[Any],
    fps: float,
    marker_set: Any,
    settings: Any,
    progress: Progress,
) -> tuple[Any, dict[str, Any]]:
    """Return the take of two or more cameras, and its figures."""
    from ..labelling.single_camera_trajectories import single_views
    from ..labelling.trajectory_linking import track_markers
    from ..labelling.trajectory_naming import name_trajectories
    from ..vision.reprojection import labelled_rms_px

    aligned: dict[str, Any] = {}
    if not args.no_time_offset:
        progress(0.95, "comparing the cameras' times")
        frames, aligned = _at_one_time(rig, frames, settings)
    progress(0.97, "joining points to trajectories")
    count = len(marker_set) if marker_set else args.markers
    tracking = track_markers(frames, _take_name(args.out), fps, count)
    single = single_views(tracking, frames, rig)
    take = replace(tracking.take, single=single)
    take = name_trajectories(take, marker_set) if marker_set else take
    return take, aligned | {
        "markers": len(take.names),
        "visible_fraction": float(take.visible.mean()),
        "all_visible_fraction": float(take.visible.all(axis=1).mean()),
        "one_camera_fraction": float((single.cameras >= 0).mean()),
        "reprojection_rms_px": labelled_rms_px(rig, frames, tracking.labels),
        "false_pieces": tracking.dropped_tracklets,
    }


def _of_one_camera(
    args: argparse.Namespace, rig: Any, frames: list[Any], fps: float, count: int | None
) -> tuple[Any, dict[str, Any]]:
    """Return the take of one camera, and its figures; its markers have no labels."""
    from ..vision.image_take import image_take

    take = image_take(frames, rig, _take_name(args.out), fps)
    shown = np.array([len(frame.single_points) for frame in frames])
    worn = count or int(shown.max())
    return take, {
        "markers": worn,
        "visible_fraction": 0.0,
        "one_camera_fraction": float(np.minimum(shown / max(worn, 1), 1.0).mean()),
        "reprojection_rms_px": None,
    }


def _check(args: argparse.Namespace) -> None:
    """Raise SettingsError for options that cannot be meant, before any work."""
    from ..formats.markers.marker_files import check_writable

    if args.markers is not None and not 1 <= args.markers <= 200:
        raise SettingsError(f"--markers {args.markers} cannot be", advice="use 1 to 200")
    if args.seconds is not None and not 0.0 < args.seconds <= 86400.0:
        raise SettingsError(f"--seconds {args.seconds:g} is out of range", advice="give more than 0, a day at most")
    if args.fps is not None and not 1.0 <= args.fps <= 1000.0:
        raise SettingsError(f"--fps {args.fps:g} is out of range", advice="give 1 to 1000 frames per second")
    check_writable(args.out)
    if args.floor == "feet" and not args.marker_set:
        raise SettingsError("--floor feet needs --marker-set", advice="name the marker set that is worn")
    if args.floor_cameras and args.floor != "feet":
        raise SettingsError("--floor-cameras needs --floor feet", advice="add it, or leave --floor-cameras out")


def _in_use(args: argparse.Namespace, rig: Any) -> tuple[Any, list[str]]:
    """Return the cameras that there are sources for, and these."""
    from ..geometry.camera import CameraRig

    names = [camera.name for camera in rig.cameras]
    given = [(index, str(source)) for index, source in enumerate((args.left, args.right)) if source is not None]
    further, named = given[-1][0] + 1 if given else 0, False
    for text in args.camera:
        name, equals, source = text.partition("=")
        if equals and name in names:
            given.append((names.index(name), source))
            named = True
        else:
            given.append((further, text))
            further += 1
    if not given:
        args.wrong_usage("the following arguments are required: --left")
    given.sort()
    indices, sources = [index for index, _ in given], [source for _, source in given]
    if len(set(indices)) < len(indices):
        raise SettingsError("one camera has two sources", where="--camera", advice="name each camera once")
    twice = next((source for source in sources if sources.count(source) > 1), None)
    if twice is not None:
        raise SettingsError(f"two cameras have one source, {twice}", advice="give each camera its own pictures")
    if len(given) == 1:
        _check_one_camera(args)
    elif not named:
        return rig, sources
    if indices[-1] >= len(rig):
        raise SettingsError(
            f"the calibration has {len(rig)} camera(s)", where=str(args.cameras), advice="use one of this set-up"
        )
    return CameraRig(tuple(rig.cameras[index] for index in indices), rig.metadata), sources


def _check_one_camera(args: argparse.Namespace) -> None:
    """Raise SettingsError for options that need more than one camera."""
    if not str(args.out).lower().endswith(".take.npz"):
        raise SettingsError(f"{args.out} cannot hold what one camera shows", advice="write a .take.npz")
    for option, value in (("--floor feet", args.floor == "feet"), ("--truth", args.truth)):
        if value:
            raise SettingsError(
                f"{option} needs markers in space, which one camera does not give", advice="leave it out"
            )


def _on_floor(args: argparse.Namespace, take: Any, rig: Any) -> Any:
    """Return the take with its floor at y = 0; write that calibration if requested."""
    from ..geometry.rig_file import save_rig
    from ..markers.floor_from_feet import floor_points, to_rig_world
    from ..markers.marker_set import load_marker_set
    from ..vision.calibration.floor import rig_on_floor

    level = rig_on_floor(rig, floor_points(take, load_marker_set(args.marker_set)))
    if args.floor_cameras:
        save_rig(level, args.floor_cameras)
    return to_rig_world(take, rig, level)


def _pipeline(args: argparse.Namespace, rig: Any, source: Any, progress: Progress) -> Any:
    from ..vision.detection.detector import DetectionSettings
    from ..vision.pipeline import MarkerPipeline, PipelineSettings
    from ..vision.sources.spec import open_image_source

    settings = PipelineSettings(detection=(DetectionSettings(threshold=args.threshold),))
    pipeline = MarkerPipeline(rig, settings)
    progress(0.0, "learning the background")
    if args.background:
        empty = open_image_source(*args.background)
        try:
            pipeline.learn_empty(empty.samples(_EMPTY_SAMPLES))
        finally:
            empty.close()
        return pipeline
    samples = [] if _endless(source) else list(source.samples(_BACKGROUND_SAMPLES))
    if len(samples) > 1:
        pipeline.learn_from_take(samples)
    return pipeline


def _endless(source: Any) -> bool:
    return int(getattr(source, "frames", 0)) <= 0


def _process(args: argparse.Namespace, pipeline: Any, source: Any, progress: Progress) -> tuple[list[Any], float]:
    if _endless(source) and args.seconds is None:
        raise SettingsError("a camera has no end", advice="say how long to record, e.g. --seconds 10")
    total = int(getattr(source, "frames", 0)) or round(args.seconds * source.fps)
    frames, seconds = [], 0.0
    for images in source:
        if args.seconds is not None and max(images.times_s) >= args.seconds:
            break
        start = time.perf_counter()
        frames.append(pipeline.process(images))
        seconds += time.perf_counter() - start
        if len(frames) % 10 == 0:
            progress(min(0.95, 0.95 * len(frames) / max(total, 1)), f"frame {len(frames)} of {total}")
    return frames, seconds


def _at_one_time(rig: Any, frames: list[Any], settings: Any) -> tuple[list[Any], dict[str, Any]]:
    """Return the frames at one time, and each camera's time offset."""
    from ..vision.synchronise import synchronise_frames

    moved, offsets = synchronise_frames(rig, frames, settings)
    return moved, {
        "time_offsets_ms": [1e3 * offset.offset_s if offset.is_found else None for offset in offsets],
        "time_offset_sigmas_ms": [1e3 * offset.sigma_s if offset.is_found else None for offset in offsets],
        "time_offsets_applied": any(offset.is_certain for offset in offsets),
    }


def _take_name(out: str) -> str:
    return Path(out).name.removesuffix(".npz").removesuffix(".take").split(".")[0] or "take"


def _without_distortion(rig: Any) -> Any:
    return replace(rig, cameras=tuple(replace(camera, distortion=np.zeros(5)) for camera in rig.cameras))


def _compared(take: Any, path: str) -> dict[str, Any]:
    """Return the distances to true trajectories, paired to fit best over the take."""
    from ..formats.markers.marker_files import read_take
    from ..labelling.trajectory_naming import match_trajectories

    truth = read_take(path)
    frames = min(take.frames, truth.frames)
    own, other = take.positions_m[:frames], truth.positions_m[:frames]
    # trajectories in the left camera's own frame (x right, y down, z forward) are turned into the world
    turned = other * np.array([1.0, -1.0, -1.0])
    if np.nanmedian(np.abs(own[..., 2] - turned[..., 2])) < np.nanmedian(np.abs(own[..., 2] - other[..., 2])):
        other = turned
    rows, columns = match_trajectories(own, other)
    distance = np.linalg.norm(own[:, rows] - other[:, columns], axis=2)
    return {
        "truth_frames": frames,
        "truth_pairs": {take.names[r]: truth.names[c] for r, c in zip(rows, columns, strict=True)},
        "distance_median_mm": 1000.0 * float(np.nanmedian(distance)),
        "distance_p95_mm": 1000.0 * float(np.nanpercentile(distance, 95)),
    }
