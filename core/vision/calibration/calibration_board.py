"""Calibration boards: their descriptions as text (SPEC), their points, and their detection in a picture."""

import re
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from ...errors import CalibrationError, SettingsError
from ...geometry.arrays import Array, Image, IntArray

SPEC_HELP = (
    "chessboard:COLUMNSxROWS:SQUARE (inner corners, e.g. chessboard:9x6:24.23mm) or "
    "charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares, e.g. charuco:7x5:40mm:30mm:DICT_4X4_50)"
)

_UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "": 1e-3}
_LENGTH = r"\s*([0-9]*\.?[0-9]+(?:e[-+]?[0-9]+)?)\s*(mm|cm|m|in|)\s*"
_SPEC = re.compile(
    rf"(chessboard|charuco):\s*(\d+)\s*x\s*(\d+)\s*:{_LENGTH}(?::{_LENGTH}:(\w+)(:inverted)?)?", re.IGNORECASE
)


@dataclass(frozen=True)
class BoardSearchSettings:
    """Settings for finding a board in a picture."""

    # On two public sets of 640-pixel pictures, doubling the size lowers the stereo error from 0.28 to 0.19 px and from
    # 0.34 to 0.27 px. A cut-out with a smaller margin makes single corners jump.
    enlargement: int = 2
    cut_margin: float = 6.0  # margin around the corners, in squares
    least_charuco_corners: int = 6
    glimpse_width: int = 400  # image width of the fast search, pixels; as reliable as 640 pixels in half the time
    glimpse_codes_width: int = 960  # the same for ChArUco boards, whose codes are smaller than squares
    glimpse_scale: float = 0.5  # smallest scale of the fast search: in large images, boards may be small
    reach: float = 0.3  # half the side of the window that refines a corner, in squares


_SEARCH = BoardSearchSettings()


@dataclass(frozen=True)
class Board:
    """A planar board."""

    kind: str
    columns: int  # inner corners of a chessboard, squares of a ChArUco board
    rows: int
    square_m: float
    marker_m: float = 0.0  # this and the following are for ChArUco boards only
    dictionary: str = ""
    inverted: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("chessboard", "charuco"):
            raise SettingsError(f"unknown board kind {self.kind!r}", advice=f"use {SPEC_HELP}")
        if not (min(self.columns, self.rows) >= 3 and max(self.columns, self.rows) <= 100):
            raise CalibrationError(
                f"a board of {self.columns}x{self.rows} cannot be used", advice="use a board of 3x3 to 100x100"
            )
        if not (np.isfinite(self.square_m) and self.square_m > 0.0):
            raise CalibrationError(
                "the board's square must be larger than zero", advice="measure one printed square, e.g. 24.2mm"
            )
        if self.kind == "charuco" and not 0.0 < self.marker_m < self.square_m:
            raise CalibrationError(
                "a ChArUco marker must be smaller than its square", advice="give both sizes as measured"
            )

    @property
    def corner_grid(self) -> tuple[int, int]:
        """Number of inner corners in columns and rows."""
        if self.kind == "chessboard":
            return self.columns, self.rows
        return self.columns - 1, self.rows - 1

    @property
    def is_ambiguous(self) -> bool:
        """Whether the board looks the same after half a turn, because it has no markers."""
        return self.kind == "chessboard"

    @property
    def points_m(self) -> Array:
        """Inner corners (N, 3) in the board's plane z = 0, row by row."""
        columns, rows = self.corner_grid
        grid = np.zeros((rows * columns, 3))
        grid[:, 0] = np.tile(np.arange(columns), rows) * self.square_m
        grid[:, 1] = np.repeat(np.arange(rows), columns) * self.square_m
        return grid


@dataclass(frozen=True)
class BoardView:
    """Board points in one picture."""

    ids: IntArray  # (n,) indices into `Board.points_m`
    pixels: Array  # (n, 2)
    motion_px_s: Array | None = None  # (n, 2), known in a video
    edge_widths_px: tuple[float, float] | None = None  # as `board_quality.edge_widths` measures them

    def reverse(self) -> "BoardView":
        """Return the view of a whole board with its corners numbered from the other end."""
        motion = None if self.motion_px_s is None else self.motion_px_s[::-1].copy()
        return replace(self, pixels=self.pixels[::-1].copy(), motion_px_s=motion)


def parse_board(spec: str) -> Board:
    """Return the board that a SPEC describes; a length without a unit is in millimetres.

    Raises:
        SettingsError: The text is not a SPEC.
        CalibrationError: Sizes are impossible (no square, a marker larger than its square).
    """
    match = _SPEC.fullmatch(spec.strip())
    kind = match[1].lower() if match else ""
    if match is None or (kind == "charuco") != (match[6] is not None):
        raise SettingsError("does not describe a board", where=repr(spec), advice=f"use {SPEC_HELP}")
    columns, rows, square_m = int(match[2]), int(match[3]), float(match[4]) * _UNITS_M[match[5].lower()]
    if kind == "chessboard":
        return Board(kind, columns, rows, square_m)
    marker_m = float(match[6]) * _UNITS_M[match[7].lower()]
    board = Board(kind, columns, rows, square_m, marker_m, match[8].upper(), match[9] is not None)
    needed, there = columns * rows // 2, len(_dictionary(board.dictionary).bytesList)
    if needed > there:
        raise SettingsError(
            f"{columns}x{rows} squares need {needed} codes, but {board.dictionary} has {there}",
            where="board",
            advice="choose a dictionary with more, e.g. DICT_4X4_250",
        )
    return board


def _dictionary(name: str) -> Any:
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if not isinstance(number, int):
        raise SettingsError(f"unknown ArUco dictionary {name!r}", advice="use a name such as DICT_4X4_50")
    return cv2.aruco.getPredefinedDictionary(number)


def charuco_board(board: Board, is_old: bool = False) -> Any:
    """Return OpenCV's object for a ChArUco board, in metres.

    Args:
        is_old: Use the pattern of OpenCV up to 4.5: with an even number of rows, the first square is white, not black.
    """
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, board.marker_m, _dictionary(board.dictionary)
    )
    made.setLegacyPattern(is_old)
    return made


def find_board(image: Image, board: Board) -> BoardView | None:
    """Return the board's corners in a picture (grey or BGR), or None if there is no board.

    A chessboard is found completely or not at all; it may be numbered from either end, because it looks the same after
    half a turn. The calibration resolves this between the cameras.
    """
    grey = grey_of(image)
    if board.kind == "charuco":
        return _find_charuco(grey, board)
    rough = _rough_corners(grey, board.corner_grid)
    if rough is None:
        return None
    spacing = corner_spacing(rough, board.corner_grid)
    fine = _fine_corners(grey, board.corner_grid, rough, spacing)
    return _whole_view(_refine(grey, rough, spacing) if fine is None else fine)


def _whole_view(pixels: Array) -> BoardView:
    return BoardView(np.arange(len(pixels), dtype=np.int64), pixels)


def glimpse_board(image: Image, board: Board) -> BoardView | None:
    """Return the board's corners found in a reduced image: faster, accurate to about a pixel."""
    grey = grey_of(image)
    width = _SEARCH.glimpse_codes_width if board.kind == "charuco" else _SEARCH.glimpse_width
    scale = min(1.0, max(_SEARCH.glimpse_scale, width / grey.shape[1]))
    small = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if board.kind == "charuco":
        view = _find_charuco(small, board)
    else:
        pixels = _corners_in_sectors(small, board.corner_grid, cv2.CALIB_CB_NORMALIZE_IMAGE)
        view = None if pixels is None else _whole_view(pixels)
    return None if view is None else BoardView(view.ids, (view.pixels + 0.5) / scale - 0.5)


def grey_of(image: Image) -> Image:
    """Return a grey or BGR image as a grey one."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    return np.asarray(grey, dtype=np.uint8)


def _find_charuco(grey: Image, board: Board) -> BoardView | None:
    picture = 255 - grey if board.inverted else grey
    for is_old in (False, True)[: 1 + (board.rows % 2 == 0)]:
        corners, ids, _, codes = cv2.aruco.CharucoDetector(charuco_board(board, is_old)).detectBoard(picture)
        is_found = ids is not None and len(ids) >= _SEARCH.least_charuco_corners
        if is_found or codes is None or len(codes) < 2:  # codes would be seen on an older board, too
            break
    if not is_found:
        return None
    found = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    apart = np.linalg.norm(found[:, None] - found[None], axis=2) + np.diag(np.full(len(found), np.inf))
    # refined again: up to OpenCV 4.12 the detector's corners are half a pixel off (opencv issue 25539)
    return BoardView(
        np.asarray(ids, dtype=np.int64).ravel(), _refine(grey, found, float(apart.min()), edge_reach(board))
    )


def edge_reach(board: Board) -> float:
    """Return the distance from a corner, in squares, within which there are no markers."""
    free = 1.0 if board.kind == "chessboard" else 0.5 * (1.0 - board.marker_m / board.square_m)
    return min(_SEARCH.reach, free)


def _refine(grey: Image, corners: Array, spacing: float, reach: float = _SEARCH.reach) -> Array:
    # the window stays within the four squares around a corner, because their far edges would bias the corner
    window = int(np.clip(reach * spacing, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    start = corners.astype(np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start, (window, window), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _corners_in_sectors(grey: Image, grid: tuple[int, int], flags: int) -> Array | None:
    """Search with OpenCV's sector-based finder, which rejects parts of boards."""
    found, corners = cv2.findChessboardCornersSB(grey, grid, flags=flags)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def _rough_corners(grey: Image, grid: tuple[int, int]) -> Array | None:
    for flags in (cv2.CALIB_CB_NORMALIZE_IMAGE, cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE):
        corners = _corners_in_sectors(grey, grid, flags)
        if corners is not None:
            return corners
    found, pixels = cv2.findChessboardCorners(grey, grid)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) if found else None


def _fine_corners(grey: Image, grid: tuple[int, int], rough: Array, spacing: float) -> Array | None:
    """Refine corners in an enlarged cut-out; keep the numbering of `rough`."""
    margin = _SEARCH.cut_margin * spacing
    height, width = grey.shape
    left, top = np.maximum(np.floor(rough.min(axis=0) - margin), 0).astype(int)
    right = min(int(rough[:, 0].max() + margin) + 1, width)
    bottom = min(int(rough[:, 1].max() + margin) + 1, height)
    cut = np.ascontiguousarray(grey[top:bottom, left:right])
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    corners = _corners_in_sectors(_enlarged(cut), grid, flags)
    if corners is None:
        return None
    # pixel centres are at integers: enlarging moves the centre of pixel 0 to half a pixel
    pixels = (corners + 0.5) / _SEARCH.enlargement - 0.5 + (left, top)
    if np.sum((pixels[-1] - pixels[0]) * (rough[-1] - rough[0])) < 0.0:
        pixels = pixels[::-1].copy()
    if np.abs(pixels - rough).max() > 0.5 * spacing:
        return None
    return pixels


def _enlarged(grey: Image) -> Image:
    times = _SEARCH.enlargement
    return np.asarray(cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def corner_spacing(corners: Array, grid: tuple[int, int]) -> float:
    """Return the smallest distance between neighbouring corners (rows*columns, 2), pixels."""
    table = corners.reshape(grid[1], grid[0], 2)
    along = np.linalg.norm(np.diff(table, axis=1), axis=-1)
    down = np.linalg.norm(np.diff(table, axis=0), axis=-1)
    return float(min(along.min(), down.min()))


def seen_grid(image: Image, smallest: tuple[int, int]) -> tuple[int, int] | None:
    """Return the number of inner corners (larger first) of any chessboard in view, or None.

    Boards of at least `smallest` are searched for first, then any size, which often finds only a part.
    """
    large = _enlarged(grey_of(image))
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    for grid in (smallest, (4, 3)):
        found, _, meta = cv2.findChessboardCornersSBWithMeta(large, grid, flags)
        if found and meta is not None:
            return max(meta.shape[:2]), min(meta.shape[:2])
    return None
