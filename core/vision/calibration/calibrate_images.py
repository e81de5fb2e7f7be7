"""Camera calibration from image files, with checks of the pictures."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np

from ...errors import CalibrationError, CaptureError, counted
from ...system.progress import Progress
from ..sources.image_files import by_number, list_images, read_image
from .board_quality import with_edge_widths
from .calibrate import CalibrationResult, calibrate_from_points
from .calibration_board import Board, BoardView, find_board, seen_grid
from .rig_fit import MINIMUM_VIEWS, CameraViews, Rejected


def calibrate_images(
    patterns: Mapping[str, str], board: Board, progress: Progress, *, left_right: bool = True
) -> CalibrationResult:
    """Calibrate cameras from pictures of a board.

    Args:
        patterns: Folder or glob of each camera's pictures, by camera name; pictures of one moment share a number.
        left_right: Check that the first two are the left and the right camera.

    Raises:
        CalibrationError: Missing or unreadable pictures, another board, too few views, or exchanged cameras.
    """
    files, rejected = _paired_files(patterns)
    shown = _most_seen_grid(files, board) if board.kind == "chessboard" else None
    if shown is not None and min(np.subtract(shown, _larger_first(board))) >= 0:
        _check_size(shown, board)  # first, because the search for a wrong board would take minutes
    total = sum(len(rows) for rows in files.values())
    done = 0

    def report(path: Path) -> None:
        nonlocal done
        progress(0.9 * done / total, f"looking for the board: {path.name}")
        done += 1

    cameras = []
    for name, rows in files.items():
        camera = _camera_views(name, rows, board, rejected, report)
        if len(camera.views) < MINIMUM_VIEWS:
            _check_size(shown, board)
            raise CalibrationError(
                f"the board was found in {len(camera.views)} of {counted(len(rows), 'picture')}",
                where=f"camera {name}",
                advice="check the size of the board, and that all of it is in the pictures, sharp and lit",
            )
        cameras.append(camera)
    progress(0.9, "calibrating")
    return calibrate_from_points(board.points_m, cameras, rejected, left_right=left_right, ambiguous=board.is_ambiguous)


def _paired_files(patterns: Mapping[str, str]) -> tuple[dict[str, dict[str, Path]], list[Rejected]]:
    """Return each camera's files by moment, and the rejected files, whose number no other camera has."""
    try:
        lists = {name: list_images(pattern) for name, pattern in patterns.items()}
        tables = dict(zip(lists, by_number(list(lists.values())), strict=True))
    except CaptureError as error:
        raise CalibrationError(error.what, where=error.where, advice=error.advice) from error
    counts = Counter(number for table in tables.values() for number in table)
    files = {
        name: {f"{number:06d}": table[number] for number in sorted(table) if counts[number] > 1 or len(tables) == 1}
        for name, table in tables.items()
    }
    used = {path for rows in files.values() for path in rows.values()}
    alone = [path for paths in lists.values() for path in paths if path not in used]
    reason = "no picture of the other camera has its number" if len(lists) == 2 else "no other camera has its number"
    return files, [Rejected(path.name, reason) for path in alone]


def _camera_views(
    name: str, files: Mapping[str, Path], board: Board, rejected: list[Rejected], report: Callable[[Path], None]
) -> CameraViews:
    """Return the board in a camera's pictures; pictures without it, or of an unusual size, are rejected."""
    sizes: dict[str, tuple[int, int]] = {}
    views: dict[str, BoardView] = {}
    for key, path in files.items():
        report(path)
        try:
            image = read_image(path)
        except CaptureError as error:
            rejected.append(Rejected(path.name, error.what))
            continue
        sizes[key] = (image.shape[1], image.shape[0])
        view = find_board(image, board)
        if view is None:
            rejected.append(Rejected(path.name, "the board was not found"))
        else:
            views[key] = with_edge_widths(view, image, board)
    if not sizes:
        raise CalibrationError("none of the pictures can be read", where=f"camera {name}", advice="check the files")
    usual = Counter(sizes.values()).most_common(1)[0][0]
    for key in [key for key in views if sizes[key] != usual]:
        (width, height), _ = sizes[key], views.pop(key)
        rejected.append(Rejected(f"{name} {key}", f"is {width}x{height}, but the others are {usual[0]}x{usual[1]}"))
    return CameraViews(name, usual, views)


def _check_size(shown: tuple[int, int] | None, board: Board) -> None:
    """Raise CalibrationError if the pictures show a larger board, part of which would be found but calibrate badly."""
    asked = _larger_first(board)
    if shown is not None and shown != asked:
        raise CalibrationError(
            f"the pictures show a board of {shown[0]}x{shown[1]} inner corners, not {asked[0]}x{asked[1]}",
            advice=f"describe the board as chessboard:{shown[0]}x{shown[1]}, with the side of a square",
        )


def _larger_first(board: Board) -> tuple[int, int]:
    return max(board.corner_grid), min(board.corner_grid)


def _most_seen_grid(files: Mapping[str, Mapping[str, Path]], board: Board) -> tuple[int, int] | None:
    """Return the grid of inner corners that at least three of five sampled pictures show, or None."""
    paths = [path for rows in files.values() for path in rows.values()]
    chosen = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, 5).astype(int))]
    shown: dict[tuple[int, int], set[Path]] = defaultdict(set)
    for attempt in range(3):
        # OpenCV's finder uses random numbers: in a difficult picture it may find the whole board or a part of it
        cv2.setRNGSeed(attempt)
        for path in chosen:
            try:
                grid = seen_grid(read_image(path), board.corner_grid)
            except CaptureError:
                continue
            if grid is not None:
                shown[grid].add(path)
                if len(shown[grid]) >= min(3, len(chosen)):
                    return grid
    return None
