"""`perfanim track`: images of calibrated cameras to a take."""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from ..database.store import open_database
from ..errors import SettingsError
from ..formats.markers.marker_files import check_ending, is_recorded
from ..geometry.camera import CameraRig
from ..geometry.rig_file import load_rig
from ..system.progress import Progress
from .options import add_choice, add_command, add_number, add_repeated, add_switch, add_text, check_fps
from .performer_options import add_body_options, chosen_marker_set, chosen_subject


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "track", run, "images to marker trajectories, or to a recorded take")
    add_text(parser, "--cameras", "cameras.toml", "calibration (anipose-style TOML)", required=True)
    source = "a video, a folder or pattern of images, a device number, a stream address"
    add_text(parser, "--left", "SRC", source + "; alone: one camera, with more markers")
    add_text(parser, "--right", "SRC", "the same for the right camera")
    add_repeated(
        parser,
        "--camera",
        "[NAME=]SRC",
        "any further camera, in the calibration's order; or with its name there, of which others may be left out",
    )
    written = (
        "take to write: .take.npz, .trc, .csv or .c3d; or .perftake, all that the cameras saw, without labels: "
        "`solve` labels and solves it as live"
    )
    add_text(parser, "--out", "TAKE", written, required=True)
    _add_body_options(parser)
    empty = "frames without the performer, one source per camera (default: learned from the take itself)"
    add_text(parser, "--background", "SRC", empty, nargs="+")
    add_number(parser, "--threshold", "LEVELS", "grey levels above the background (default: automatic)")
    add_number(parser, "--fps", "RATE", "frames per second, where the source does not tell")
    add_number(parser, "--seconds", "S", "stop after so many seconds (needed for cameras)")
    add_switch(
        parser,
        "--no-time-offset",
        "take images of one number as of one moment (default: where the motion shows that a camera is late, its "
        "markers are brought to the time of the others)",
    )
    distortion = "leave the lens distortion out, to compare with results of programs that do (default: corrected)"
    add_switch(parser, "--ignore-distortion", distortion)
    add_text(parser, "--truth", "TAKE", "trajectories to compare with, frame by frame (.trc, .c3d, .csv, .take.npz)")
    floor = (
        "the take's world: the left camera's level (camera), or with the floor where the feet stand at y = 0 "
        "(feet; needs --marker-set with markers on the feet) (default camera)"
    )
    add_choice(parser, "--floor", ("camera", "feet"), floor, default="camera")
    add_text(parser, "--floor-cameras", "FILE", "with --floor feet: also write the calibration in that world")


def _add_body_options(parser: argparse.ArgumentParser) -> None:
    subject = "calibrated subject: labels the markers, with --database"
    add_body_options(parser, subject, ".asf or .bvh with the bones; needs --marker-set")
    add_text(parser, "--database", "DB", "motion database, to label the markers by the body")
    worn = "markers worn (default: the subject's); without a body their labels are guessed (default: M01, M02, ...)"
    add_text(parser, "--marker-set", "NAME_OR_FILE", worn)
    count = "how many markers are worn (default: the set's, or as many as are seen at most times)"
    add_text(parser, "--markers", "N", count, type=int)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..api.tracking import TrackRequest, track  # OpenCV is slow to load

    _check(args)
    marker_set = chosen_marker_set(args)
    subject = chosen_subject(args, marker_set)
    database = open_database(args.database) if args.database else None
    rig, sources = _cameras_and_sources(args, load_rig(args.cameras))
    if args.ignore_distortion:
        rig = replace(rig, cameras=tuple(replace(camera, distortion=np.zeros(5)) for camera in rig.cameras))
    request = TrackRequest(
        rig,
        sources,
        args.out,
        subject.marker_set if subject else marker_set,
        subject,
        database,
        background=args.background or (),
        threshold=args.threshold,
        fps=args.fps,
        seconds=args.seconds,
        markers=args.markers,
        time_offsets=not args.no_time_offset,
        floor=args.floor,
        level_rig=args.floor_cameras,
        truth=args.truth,
    )
    return track(request, progress)


def _check(args: argparse.Namespace) -> None:
    """Raise SettingsError for options that contradict each other, before any work."""
    if args.markers is not None and not 1 <= args.markers <= 200:
        raise SettingsError(f"--markers {args.markers} is out of range", advice="give 1 to 200")
    if args.seconds is not None and not 0.0 < args.seconds <= 86400.0:
        raise SettingsError(f"--seconds {args.seconds:g} is out of range", advice="give more than 0, a day at most")
    check_fps(args.fps)
    if is_recorded(args.out):
        _check_left_out(args, "labels, which a .perftake gets when it is solved")
    else:
        check_ending(args.out)
        if (args.subject or args.skeleton) and not args.database:
            args.wrong_usage("argument --database is required: the body labels the markers by it")
        if args.database and not (args.subject or args.skeleton):
            args.wrong_usage("argument --database: needs --subject, or --skeleton and --marker-set")
    if args.floor == "feet" and not (args.marker_set or args.subject):
        raise SettingsError("--floor feet needs --marker-set", advice="name the marker set that is worn")
    if args.floor_cameras and args.floor != "feet":
        raise SettingsError("--floor-cameras needs --floor feet", advice="add it, or leave --floor-cameras out")


def _cameras_and_sources(args: argparse.Namespace, rig: CameraRig) -> tuple[CameraRig, list[str]]:
    """Return the rig of the cameras with sources, and the sources."""
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
        if not str(args.out).lower().endswith((".take.npz", ".perftake")):
            raise SettingsError(
                f"{args.out} cannot hold what one camera shows", advice="write a .take.npz or .perftake"
            )
        _check_left_out(args, "markers in space, which one camera does not give")
    elif not named:
        return rig, sources
    if indices[-1] >= len(rig):
        raise SettingsError(
            f"the calibration has {len(rig)} camera(s)", where=str(args.cameras), advice="use one of this set-up"
        )
    return CameraRig(tuple(rig.cameras[index] for index in indices), rig.metadata), sources


def _check_left_out(args: argparse.Namespace, need: str) -> None:
    """Raise SettingsError for options that need trajectories, where there are none."""
    for option, value in (("--floor feet", args.floor == "feet"), ("--truth", args.truth)):
        if value:
            raise SettingsError(f"{option} needs {need}", advice="leave it out")
