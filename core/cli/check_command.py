"""`perfanim check cameras` and `board`: find faults in lighting, cameras and markers."""

import argparse
from contextlib import closing
from typing import Any

from ..system.progress import Progress
from .options import add_choice, add_command, add_group, add_number, add_source_options, add_text, check_height


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "check", "find faults in lighting, cameras and markers before a capture")
    cameras = add_command(group, "cameras", _check_cameras, "pictures of the empty capture space and of a performer")
    add_source_options(
        cameras,
        "a video, or a folder or pattern of images: the performer in a T pose for two seconds, then walking about",
    )
    add_text(cameras, "--background", "SRC", "the empty capture space, one source per camera", nargs="+", required=True)
    add_text(cameras, "--marker-set", "NAME", "shipped marker set or TOML file (default boxing)", default="boxing")
    add_number(cameras, "--height", "M", "height of the performer in metres, which reveals a wrong scale more reliably")
    add_choice(
        cameras,
        "--ignore",
        ("reflections", "none"),
        "reflections: store the places of reflections in the calibration, so that tracking and captures ignore them "
        "(and any marker there); none: clear the stored places",
    )
    board = add_command(group, "board", _check_board, "pictures of the calibration board")
    add_text(board, "--left", "SRC", "a video, or a folder or pattern of images of the board", required=True)
    add_text(board, "--right", "SRC", "the same for the right camera", required=True)
    add_text(board, "--board", "SPEC", "as for calibrate cameras, such as chessboard:9x6:24.23mm", required=True)


def _check_cameras(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..geometry.rig_file import load_rig, save_ignored
    from ..markers.marker_set import load_marker_set
    from ..subjects.setup_check.find_faults import check_setup
    from ..vision.common_space import common_space
    from ..vision.detection.background import learn_backgrounds
    from ..vision.sources.source_kinds import open_image_source

    check_height(args.height)
    rig, marker_set = load_rig(args.cameras), load_marker_set(args.marker_set)
    if args.ignore == "none":
        rig = rig.ignoring(())
    progress(0.0, "learning the background")
    with closing(open_image_source(*args.background)) as empty:
        backgrounds = learn_backgrounds(empty.samples(60))
    with closing(open_image_source(args.left, args.right, *args.camera, size=rig.cameras[0].image_size)) as source:
        most = max(int(20.0 * source.fps), 1)  # the first 20 s suffice
        moments = _first(source, most, progress)
        findings = check_setup(rig, backgrounds, moments, marker_set, args.height)
    places = rig.ignored.tolist()
    if args.ignore == "reflections":
        places += [place for finding in findings for place in finding.places]
    if args.ignore:
        save_ignored(args.cameras, places)
    return _summary(findings) | {"ignored_places": len(places), "space": common_space(rig, args.height or 1.8).text}


def _check_board(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..subjects.setup_check.board_faults import board_faults
    from ..vision.calibration.calibration_board import BoardView, find_board, parse_board
    from ..vision.sources.source_kinds import open_image_source

    board = parse_board(args.board)
    views: dict[str, list[BoardView]] = {"the left camera": [], "the right camera": []}
    moments = 30
    with closing(open_image_source(args.left, args.right)) as source:
        for number, images in enumerate(source.samples(moments)):
            progress(number / moments, "looking for the board")
            for seen, image in zip(views.values(), images, strict=True):
                view = find_board(image, board)
                seen += [view] if view is not None else []
    return _summary(board_faults(board, views)) | {"views": {title: len(seen) for title, seen in views.items()}}


def _first(source: Any, most: int, progress: Progress) -> Any:
    """Yield the first `most` sets of images of a source."""
    for number, moment in enumerate(source):
        if number == most:
            return
        progress(number / most, "looking at the pictures")
        yield moment


def _summary(findings: Any) -> dict[str, Any]:
    texts = [{"fault": str(finding.fault), "advice": finding.text} for finding in findings]
    return {"verdict": "fix first" if texts else "good", "findings": texts}
