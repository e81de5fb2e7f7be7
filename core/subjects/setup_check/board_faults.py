"""Faults of the calibration board, found in pictures of it."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...vision.calibration.calibration_board import Board, BoardView
from .finding import Fault, Finding

_SMALLEST_SQUARE_PX = 12.0  # corners of smaller squares disturb each other and show little of the lens's distortion


def board_faults(board: Board, views: Mapping[str, Sequence[BoardView]]) -> list[Finding]:
    """Return a finding for each camera in whose pictures the board is too small.

    Args:
        views: Detections of the board by each camera.
    """
    findings = []
    for camera, seen in views.items():
        sizes = [square_px(board, view) for view in seen]
        size = float(np.percentile(sizes, 75.0)) if sizes else float("nan")
        if size < _SMALLEST_SQUARE_PX:
            text = f"the board is too small in {camera}'s pictures: its squares are {int(size)} pixels wide"
            text += f", {_SMALLEST_SQUARE_PX:.0f} are needed; hold it nearer, or print a larger one"
            findings.append(Finding(Fault.BOARD_SMALL, camera, text))
    return findings


def square_px(board: Board, view: BoardView) -> float:
    """Return the median side length of the board's squares in a view, pixels."""
    columns = board.corner_grid[0]
    place = {int(number): pixel for number, pixel in zip(view.ids, view.pixels, strict=True)}
    pairs = [(n, n + 1) for n in place if (n + 1) % columns] + [(n, n + columns) for n in place]
    sides = [np.linalg.norm(place[a] - place[b]) for a, b in pairs if b in place]
    return float(np.median(sides)) if sides else float("nan")
