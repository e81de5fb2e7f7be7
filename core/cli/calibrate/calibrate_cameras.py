"""`perfanim calibrate cameras` and `board`: calibrate cameras with a board or without; make the board to print."""

import argparse
from typing import Any

from ...api.calibration import calibrate_cameras
from ...errors import SettingsError
from ...geometry.rig_file import save_rig
from ...system.progress import Progress
from ..options import add_command, add_repeated, add_text
from .calibrate_without_board import add_options_without_board, calibrate_without_board, wants_no_board


def add_parser(group: Any) -> None:
    about = "intrinsics, distortion and relative pose, from pictures of a board or of a person who walks about"
    parser = add_command(group, "cameras", calibrate, about)
    add_text(parser, "--left", "GLOB", "pictures of the left camera: a folder or a pattern in quotes; or a video")
    add_text(parser, "--right", "GLOB", "pictures of the right camera, paired by their numbers; or a video")
    add_repeated(
        parser,
        "--camera",
        "NAME=GLOB",
        "any further camera, or all of them (repeatable); each must see the board at the same time as another",
    )
    add_text(
        parser,
        "--board",
        "SPEC",
        "chessboard:9x6:24.23mm (inner corners and square size; mm if no unit is given) or "
        "charuco:7x5:40mm:30mm:DICT_4X4_50 (squares, square size, marker size, dictionary; "
        "append :inverted for a white-on-black board)",
    )
    add_options_without_board(parser)
    add_text(parser, "--points", "FILE", "instead of pictures: JSON of board points already found (mm and pixels)")
    add_text(parser, "--out", "cameras.toml", "the calibration to write", required=True)
    board = add_command(group, "board", write_board, "write the board as a PDF to print")
    board.add_argument("--spec", "--board", metavar="SPEC", required=True, help="as for `calibrate cameras`")
    add_text(board, "--out", "board.pdf", "the PDF to write", required=True)


def write_board(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ...vision.calibration.board_pdf import write_board_pdf
    from ...vision.calibration.calibration_board import parse_board

    return {"out": str(args.out), "paper": write_board_pdf(parse_board(args.spec), args.spec, args.out)}


def calibrate(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if wants_no_board(args):
        return calibrate_without_board(args, _patterns(args), progress)
    from ...vision.calibration.board_points import load_board_points  # OpenCV is slow to load
    from ...vision.calibration.calibrate import calibrate_from_points, calibration_summary
    from ...vision.calibration.calibration_board import parse_board

    if args.points:
        square_m = 0.0
        result = calibrate_from_points(*load_board_points(args.points))
    else:
        patterns = _patterns(args)
        if not args.board:
            advice = "name the board, e.g. --board chessboard:9x6:24.23mm, or calibrate --by-walking"
            raise SettingsError("--board is missing", advice=advice)
        square_m = parse_board(args.board).square_m
        result = calibrate_cameras(patterns, args.board, progress, left_right=bool(args.left))
    save_rig(result.rig, args.out)
    return {**calibration_summary(result, square_m), "out": str(args.out)}


def _patterns(args: argparse.Namespace) -> dict[str, str]:
    patterns: dict[str, str] = {}
    if bool(args.left) != bool(args.right):
        raise SettingsError("--left and --right go together", advice="give the pictures of both cameras")
    if args.left:
        patterns |= {"left": args.left, "right": args.right}
    for entry in args.camera:
        name, separator, pattern = entry.partition("=")
        if not (name and separator and pattern) or name in patterns:
            advice = "give each camera once, such as --camera top='top/*.png'"
            raise SettingsError(f"{entry!r} is not NAME=GLOB, or repeats a name", where="--camera", advice=advice)
        patterns[name] = pattern
    if not patterns:
        raise SettingsError("pictures of each camera are needed", advice="give --left and --right, or --camera")
    return patterns
