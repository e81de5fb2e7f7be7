"""`perfanim calibrate`: cameras, the board to print, the subject, a prop, cameras anew from a take."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import SettingsError
from . import floor, prop, refine, subject

if TYPE_CHECKING:
    from ...vision.calibration.calibrate import CalibrationResult

Progress = Callable[[float, str], None]


def add_parser(subparsers: Any) -> None:
    """Add the `calibrate` command group."""
    parser = subparsers.add_parser("calibrate", help="calibrate cameras, a subject or a prop, print a board")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    _add_cameras(group)
    _add_board(group)
    subject.add_parser(group)
    prop.add_parser(group)
    floor.add_parser(group)
    refine.add_parser(group)


def _add_cameras(group: Any) -> None:
    parser = group.add_parser("cameras", help="intrinsics, distortion and relative pose from pictures of a board")
    parser.add_argument(
        "--left", metavar="GLOB", help="pictures of the left camera: a folder or a pattern in quotes; or a video"
    )
    parser.add_argument(
        "--right", metavar="GLOB", help="pictures of the right camera, paired by their numbers; or a video"
    )
    parser.add_argument(
        "--camera",
        metavar="NAME=GLOB",
        action="append",
        default=[],
        help="any further camera, or all of them (repeatable); each must see the board together with another",
    )
    parser.add_argument(
        "--board",
        metavar="SPEC",
        help="chessboard:9x6:24.23mm (inner corners and a square's edge; mm when no unit is given) or "
        "charuco:7x5:40mm:30mm:DICT_4X4_50 (squares, a square's and a marker's edge, dictionary; "
        "append :inverted for a white-on-black board)",
    )
    parser.add_argument(
        "--points", metavar="FILE", help="instead of pictures: JSON of board points already found (mm and pixels)"
    )
    parser.add_argument("--out", metavar="cameras.toml", required=True, help="the calibration to write")
    parser.set_defaults(run=run_cameras)


def _add_board(group: Any) -> None:
    parser = group.add_parser("board", help="write the board as a PDF to print")
    parser.add_argument("--spec", "--board", metavar="SPEC", required=True, help="as for `calibrate cameras`")
    parser.add_argument("--out", metavar="board.pdf", required=True, help="the PDF to write")
    parser.set_defaults(run=run_board)


def run_cameras(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Calibrate, write the rig, return the summary."""
    from ...geometry.rig_file import save_rig
    from ...vision.calibration.calibrate import calibrate_from_points

    if args.points:
        from ...vision.calibration.board_points import load_board_points

        points_m, cameras = load_board_points(args.points)
        square_m = 0.0
        result = calibrate_from_points(points_m, cameras)
    else:
        from ...vision.calibration.board import parse_board

        patterns = _patterns(args)
        if not args.board:
            raise SettingsError("--board is missing", advice="name the board, e.g. --board chessboard:9x6:24.23mm")
        board = parse_board(args.board)
        square_m = board.square_m
        result = _from_files(patterns, board, progress, left_right=bool(args.left))
    save_rig(result.rig, args.out)
    return {**summary_of(result, square_m), "out": str(args.out)}


def summary_of(result: "CalibrationResult", square_m: float = 0.0) -> dict[str, Any]:
    """Return what is told of a calibration; `square_m` is the board's square, 0 where it is not known."""
    summary: dict[str, Any] = {
        "verdict": result.verdict,
        "stereo_rms_px": result.stereo_rms_px,
        "held_out_rms_px": result.held_out_px,
        "rms_px": dict(result.rms_px),
        "coverage": dict(result.coverage),
        "used": len(result.used),
        "rejected": [{"picture": row.picture, "reason": row.reason} for row in result.rejected],
        "views_px": {name: _of_camera(result.views_px, name) for name in result.rms_px},
        "advice": list(result.advice),
    }
    if len(result.rig) > 1:
        summary["baseline_mm"] = result.baseline_m * 1000.0
        summary["distance_sigma_percent"] = 100.0 * result.distance_sigma
    if result.late_s:
        summary["late_ms"] = {name: 1000.0 * late for name, late in result.late_s.items()}
    if square_m and len(result.rig) > 1:
        summary["baseline_squares"] = result.baseline_m / square_m
    return summary


def _of_camera(views_px: Mapping[tuple[str, str], float], name: str) -> dict[str, float]:
    return {picture: error for (picture, camera), error in views_px.items() if camera == name}


def _from_files(patterns: dict[str, str], board: Any, progress: Progress, *, left_right: bool) -> Any:
    from ...vision.calibration.calibrate_images import calibrate_images
    from ...vision.calibration.calibrate_videos import calibrate_videos
    from ...vision.sources.images import is_image_pattern

    videos = [name for name, pattern in patterns.items() if Path(pattern).is_file() and not is_image_pattern(pattern)]
    if videos and len(videos) < len(patterns):
        still = next(name for name in patterns if name not in videos)
        raise SettingsError(
            f"{videos[0]} is a video and {still} is not", advice="give videos of all cameras, or pictures of all"
        )
    calibrate = calibrate_videos if videos else calibrate_images
    return calibrate(patterns, board, progress, left_right=left_right)


def _patterns(args: argparse.Namespace) -> dict[str, str]:
    patterns: dict[str, str] = {}
    if bool(args.left) != bool(args.right):
        raise SettingsError("--left and --right go together", advice="give the pictures of both cameras")
    if args.left:
        patterns |= {"left": args.left, "right": args.right}
    for entry in args.camera:
        name, separator, pattern = entry.partition("=")
        if not (name and separator and pattern) or name in patterns:
            raise SettingsError(f"--camera {entry!r} is not NAME=GLOB with a new name")
        patterns[name] = pattern
    if not patterns:
        raise SettingsError("pictures of the board are needed", advice="give --left and --right, or --camera")
    return patterns


def run_board(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Write the board's PDF."""
    from ...vision.calibration.board import parse_board
    from ...vision.calibration.board_pdf import write_board_pdf

    paper = write_board_pdf(parse_board(args.spec), args.spec, args.out)
    return {"out": str(args.out), "paper": paper}
