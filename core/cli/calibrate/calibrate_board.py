"""`perfanim calibrate board`: the board to print."""

import argparse
from typing import Any

from ...system.progress import Progress
from ..options import add_text


def add_parser(group: Any) -> None:
    parser = group.add_parser("board", help="write the board as a PDF to print")
    parser.add_argument("--spec", "--board", metavar="SPEC", required=True, help="as for `calibrate cameras`")
    add_text(parser, "--out", "board.pdf", "the PDF to write", required=True)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ...vision.calibration.board_pdf import write_board_pdf
    from ...vision.calibration.calibration_board import parse_board

    paper = write_board_pdf(parse_board(args.spec), args.spec, args.out)
    return {"out": str(args.out), "paper": paper}
