"""`perfanim track`: track markers in images from calibrated cameras."""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from ..database.store import open_database
from ..errors import SettingsError, counted
from ..formats.markers.marker_files import check_ending, is_recorded
from ..geometry.camera import CameraRig
from ..geometry.rig_file import load_rig
from ..system.progress import Progress
from .options import add_command, add_repeated, add_request_options, add_switch, add_text, request_of
from .performer_options import add_body_options, chosen_marker_set, chosen_subject


def add_parser(subparsers: Any) -> None:
    from ..api.tracking import TrackRequest

    parser = add_command(subparsers, "track", run, "track markers in images, into trajectories or a recorded take")
    add_text(parser, "--cameras", "cameras.toml", "calibration (anipose-style TOML)", required=True)
    source = "a video, a folder or pattern of images, a device number or a stream address"
    add_text(parser, "--left", "SRC", f"{source}; without --right: a single camera, which needs more markers")
    add_text(parser, "--right", "SRC", "the same for the right camera")
    further = "any further camera, in the calibration's order; or any by its name there, so that others can be left out"
    add_repeated(parser, "--camera", "[NAME=]SRC", further)
    subject = "calibrated subject, to label the markers (needs --database)"
    add_body_options(parser, subject, ".asf or .bvh with the bones; needs --marker-set")
    worn = "markers worn (default: the subject's); without a body, labels are guessed (default: M01, M02, ...)"
    add_text(parser, "--marker-set", "NAME_OR_FILE", worn)
    add_text(parser, "--database", "DB", "motion database, to label the markers with the body")
    add_request_options(
        parser,
        TrackRequest,
        out="--out TAKE",
        background="--background SRC",
        threshold="--threshold LEVELS",
        fps="--fps RATE",
        seconds="--seconds S",
        markers="--markers N",
        floor="--floor",
        level_rig="--floor-cameras FILE",
        truth="--truth TAKE",
    )
    network = "track a person without markers, with this body network (default: the one that `network get` brought)"
    parser.add_argument("--people", metavar="NETWORK", nargs="?", const="", help=network)
    add_switch(
        parser,
        "--no-time-offset",
        "treat images with the same number as simultaneous (default: if the motion shows that a camera is late, its "
        "markers are shifted to the time of the others)",
    )
    distortion = "do not correct lens distortion, to compare with programs that ignore it (default: corrected)"
    add_switch(parser, "--ignore-distortion", distortion)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..api.tracking import TrackRequest, track
    from ..vision.people.network_file import body_network_file

    _check(args)
    worn = chosen_marker_set(args)
    subject = chosen_subject(args, worn)
    rig, sources = _cameras_and_sources(args, load_rig(args.cameras))
    if args.ignore_distortion:
        rig = replace(rig, cameras=tuple(replace(camera, distortion=np.zeros(5)) for camera in rig.cameras))
    request = request_of(
        TrackRequest,
        args,
        rig=rig,
        sources=tuple(sources),
        marker_set=subject.marker_set if subject else worn,
        subject=subject,
        database=open_database(args.database) if args.database else None,
        time_offsets=not args.no_time_offset,
        people=None if args.people is None else args.people or str(body_network_file()),
    )
    return track(request, progress)


def _check(args: argparse.Namespace) -> None:
    """Exit for wrong usage, or raise SettingsError, if options contradict each other; called before any work."""
    markers = ("marker_set", "markers", "threshold", "background", "database", "subject", "skeleton")
    if args.people is not None and (given := [each for each in markers if getattr(args, each, None)]):
        option = "--" + given[0].replace("_", "-")
        raise SettingsError(f"{option} is for markers, not for --people", advice="leave one of them out")
    if is_recorded(args.out):
        _check_left_out(args, "labels, which a .perftake gets when it is solved")
    else:
        check_ending(args.out)
        if (args.subject or args.skeleton) and not args.database:
            args.wrong_usage("argument --database is required: the body needs it to label the markers")
        if args.database and not (args.subject or args.skeleton):
            args.wrong_usage("argument --database: needs --subject, or --skeleton and --marker-set")
    if args.floor == "feet" and not (args.marker_set or args.subject or args.people is not None):
        raise SettingsError("--floor feet needs --marker-set", advice="name the marker set that is worn")
    if args.level_rig and args.floor != "feet":
        raise SettingsError("--floor-cameras needs --floor feet", advice="add it, or leave --floor-cameras out")


def _cameras_and_sources(args: argparse.Namespace, rig: CameraRig) -> tuple[CameraRig, list[str]]:
    """Return the rig restricted to cameras with sources, and the sources."""
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
        raise SettingsError("one camera is given two sources", where="--camera", advice="name each camera once")
    twice = next((source for source in sources if sources.count(source) > 1), None)
    if twice is not None:
        raise SettingsError(f"two cameras are given the same source, {twice}", advice="give each its own pictures")
    if len(given) == 1:
        if not str(args.out).lower().endswith((".take.npz", ".perftake")):
            raise SettingsError(
                "cannot hold what one camera shows", where=str(args.out), advice="write a .take.npz or .perftake"
            )
        _check_left_out(args, "3D markers, which one camera does not give")
    elif not named:
        return rig, sources
    if indices[-1] >= len(rig):
        raise SettingsError(
            f"has only {counted(len(rig), 'camera')}, but a source is given for camera {indices[-1] + 1}",
            where=str(args.cameras),
            advice="use the calibration of this set-up",
        )
    return CameraRig(tuple(rig.cameras[index] for index in indices), rig.metadata), sources


def _check_left_out(args: argparse.Namespace, need: str) -> None:
    """Raise SettingsError for options that need trajectories if there are none."""
    for option, value in (("--floor feet", args.floor == "feet"), ("--truth", args.truth)):
        if value:
            raise SettingsError(f"{option} needs {need}", advice="leave it out")
