"""Calibration board as a PDF for printing: vector squares, true to scale.

PDF 32000-1:2008, sections 7.5 and 8.5: one page, one content stream of filled rectangles in millimetres.
"""

from pathlib import Path

import numpy as np

from ...errors import CalibrationError
from ...system.files import atomic_path
from .calibration_board import Board, charuco_board

_PAPERS_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
_POINTS_PER_MM = 72.0 / 25.4

Rectangle = tuple[float, float, float, float]


def write_board_pdf(board: Board, spec: str, path: str | Path) -> str:
    """Write the board on the smallest paper on which it fits; return the paper's name.

    Raises:
        CalibrationError: The board is larger than A0.
    """
    black, width, height = _rectangles(board)
    paper, page_width, page_height = _paper(width, height)
    left, bottom = (page_width - width) / 2.0, (page_height - height) / 2.0
    lines = [f"{_POINTS_PER_MM:.10f} 0 0 {_POINTS_PER_MM:.10f} 0 0 cm", "0 g"]
    # the board's y axis points down as in pictures, the page's points up
    lines += [f"{left + x:.4f} {bottom + height - y - h:.4f} {w:.4f} {h:.4f} re" for x, y, w, h in black]
    lines.append("f")
    label = f"{spec}  on {paper}: print at 100 %, then measure a square and calibrate with its true size"
    label = label.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    lines.append(f"BT /F1 3 Tf {left:.3f} {max(2.0, bottom / 2.0):.3f} Td ({label}) Tj ET")
    with atomic_path(path) as temporary:
        temporary.write_bytes(_pdf("\n".join(lines).encode("latin-1"), page_width, page_height))
    return paper


def _rectangles(board: Board) -> tuple[list[Rectangle], float, float]:
    """Return black rectangles (x, y, width, height) and the board's size, in mm."""
    square, edge = board.square_m * 1000.0, board.marker_m * 1000.0
    corners = board.corner_grid
    columns, rows = corners[0] + 1, corners[1] + 1
    cells = [(c * square, r * square, (r + c) % 2 == 0) for r, c in np.ndindex(rows, columns)]
    black = [(x, y, square, square) for x, y, is_black in cells if is_black]
    if board.kind == "charuco":
        codes = charuco_board(board).getDictionary()
        bits = int(codes.markerSize) + 2
        bit, rim = edge / bits, (square - edge) / 2.0
        for marker, (x, y) in enumerate((x, y) for x, y, is_black in cells if not is_black):
            dark = np.argwhere(np.asarray(codes.generateImageMarker(marker, bits)) == 0).tolist()
            black += [(x + rim + i * bit, y + rim + j * bit, bit, bit) for j, i in dark]
    return black, columns * square, rows * square


def _paper(width: float, height: float) -> tuple[str, float, float]:
    for name, (short, long) in _PAPERS_MM.items():
        for page_width, page_height in ((long, short), (short, long)):
            if width + 16.0 <= page_width and height + 16.0 <= page_height:  # printers leave margins
                return name, page_width, page_height
    raise CalibrationError(
        f"a board of {width:.0f} x {height:.0f} mm does not fit on A0", advice="use smaller or fewer squares"
    )


def _pdf(content: bytes, width_mm: float, height_mm: float) -> bytes:
    box = f"[0 0 {width_mm * _POINTS_PER_MM:.4f} {height_mm * _POINTS_PER_MM:.4f}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
            "/Resources << /Font << /F1 << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>"
        ).encode("ascii"),
        b"<< /Length %d >>\nstream\n" % len(content) + content + b"\nendstream",
    ]
    data = b"%PDF-1.4\n"
    places = []
    for number, body in enumerate(objects, start=1):
        places.append(len(data))
        data += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    table = b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    table += b"".join(b"%010d 00000 n \n" % place for place in places)
    trailer = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, len(data))
    return data + table + trailer
