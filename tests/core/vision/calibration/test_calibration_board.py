import cv2
import numpy as np
import pytest
from perfanim.core.errors import CalibrationError, SettingsError
from perfanim.core.simulate.studio.boards import board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.calibration.board_pdf import write_board_pdf
from perfanim.core.vision.calibration.calibration_board import (
    Board,
    charuco_board,
    find_board,
    glimpse_board,
    parse_board,
    seen_grid,
)

PIXELS_PER_SQUARE = 60


def printed(board: Board) -> np.ndarray:
    """The board as printed, with a white margin of one square."""
    if board.kind == "charuco":
        size = (board.columns * PIXELS_PER_SQUARE, board.rows * PIXELS_PER_SQUARE)
        flat = charuco_board(board).generateImage(size)
    else:
        rows, columns = board.rows + 1, board.columns + 1
        squares = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 * 255).astype(np.uint8)
        flat = np.kron(squares, np.ones((PIXELS_PER_SQUARE, PIXELS_PER_SQUARE), np.uint8))
    return cv2.copyMakeBorder(flat, *[PIXELS_PER_SQUARE] * 4, cv2.BORDER_CONSTANT, value=255)


def photographed(board: Board, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A 640x480 picture of the board seen at a slant, and its true inner corners (N, 2)."""
    flat = printed(board)
    h, w = flat.shape
    corners = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]], dtype=np.float32)
    target = np.array([[150.3, 90.2], [520.7, 120.9], [480.1, 400.4], [130.6, 350.8]], dtype=np.float32)
    homography = cv2.getPerspectiveTransform(corners, target)
    # drawn four times as large and averaged down, as a sensor's pixels average
    big = np.array([[4.0, 0, 1.5], [0, 4.0, 1.5], [0, 0, 1]]) @ homography
    large = cv2.warpPerspective(flat, big, (2560, 1920), flags=cv2.INTER_LINEAR, borderValue=90)
    picture = cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA).astype(float)
    noisy = cv2.GaussianBlur(picture, (0, 0), 0.6) * 0.8 + 20 + np.random.default_rng(seed).normal(0, 2, (480, 640))
    columns, rows = board.corner_grid
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    on_flat = (grid + 2.0) * PIXELS_PER_SQUARE - 0.5
    truth = cv2.perspectiveTransform(on_flat[None].astype(np.float64), homography)[0]
    return np.clip(noisy, 0, 255).astype(np.uint8), truth


def test_spec_of_a_chessboard_counts_inner_corners():
    board = parse_board("chessboard:9x6:24.23mm")
    assert board.corner_grid == (9, 6)
    assert board.square_m == pytest.approx(0.02423)
    assert board.points_m.shape == (54, 3)
    np.testing.assert_allclose(board.points_m[10], [0.02423, 0.02423, 0])


@pytest.mark.parametrize(
    ("length", "metres"), [("24.23", 0.02423), ("2.5cm", 0.025), ("0.03m", 0.03), ("1in", 0.0254), ("3e1mm", 0.03)]
)
def test_lengths_take_units_and_are_millimetres_without(length, metres):
    assert parse_board(f"chessboard:9x6:{length}").square_m == pytest.approx(metres)


def test_spec_of_a_charuco_board_counts_squares():
    board = parse_board("charuco:7x5:40mm:30mm:dict_4x4_50:inverted")
    assert (board.columns, board.rows, board.corner_grid, board.inverted) == (7, 5, (6, 4), True)


@pytest.mark.parametrize(
    "spec",
    [
        "",
        "board",
        "chessboard:9x6",
        "chessboard:9:24mm",
        "chessboard:9x6:wide",
        "charuco:7x5:40mm:30mm:DICT_NONE",
        "charuco:11x10:40mm:30mm:DICT_4X4_50",  # needs 55 codes
    ],
)
def test_invalid_spec_is_refused_with_an_example(spec):
    with pytest.raises(SettingsError, match=r"chessboard:9x6:24\.23mm|DICT_4X4_50|DICT_4X4_250"):
        parse_board(spec)


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("chessboard:9x6:0", "larger than zero"),
        ("chessboard:2x6:10mm", "2x6"),
        ("charuco:7x5:30mm:30mm:DICT_4X4_50", "marker"),
    ],
)
def test_impossible_boards_are_refused(spec, reason):
    with pytest.raises(CalibrationError, match=reason):
        parse_board(spec)


@pytest.mark.parametrize("spec", ["chessboard:9x6:24mm", "chessboard:7x7:24mm", "charuco:8x6:40mm:30mm:DICT_4X4_50"])
def test_corners_are_exact(spec):
    board = parse_board(spec)
    picture, truth = photographed(board)
    view = find_board(picture, board)
    assert view is not None
    straight = np.abs(view.pixels - truth[view.ids])
    turned = np.abs(view.pixels - truth[::-1][view.ids])  # a chessboard may be numbered from the other end
    assert min(straight.max(), turned.max()) < 0.35
    assert min(np.sqrt(np.mean(straight**2)), np.sqrt(np.mean(turned**2))) < 0.1


@pytest.mark.parametrize("is_old", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(5, 8), (8, 5), (6, 6)])
def test_boards_of_older_programs_are_found(columns, rows, is_old):
    board = parse_board(f"charuco:{columns}x{rows}:40mm:30mm:DICT_4X4_50")
    picture = charuco_board(board, is_old).generateImage((80 * columns, 80 * rows), marginSize=40)
    view = find_board(picture, board)
    assert view is not None and len(view.ids) == (columns - 1) * (rows - 1)
    steps = view.pixels.reshape(rows - 1, columns - 1, 2)
    assert (np.diff(steps[..., 0], axis=1) > 20.0).all() and (np.diff(steps[..., 1], axis=0) > 20.0).all()


def test_glimpse_finds_a_distant_charuco_board():
    """Held three metres away: its codes are some twenty pixels wide."""
    board = parse_board("charuco:7x5:120mm:90mm:DICT_4X4_50")
    for picture in board_pictures(Renderer(default_rig()), board, count=3):
        for image in picture.images:
            found, glimpsed = find_board(image, board), glimpse_board(image, board)
            assert found is not None and glimpsed is not None
            _, ours, theirs = np.intersect1d(glimpsed.ids, found.ids, return_indices=True)
            assert len(ours) >= 0.8 * len(found.ids)
            assert np.median(np.linalg.norm(glimpsed.pixels[ours] - found.pixels[theirs], axis=1)) < 1.0


def test_image_without_a_board_has_no_view():
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    assert find_board(noise, parse_board("chessboard:9x6:24mm")) is None
    assert find_board(noise, parse_board("charuco:8x6:40mm:30mm:DICT_4X4_50")) is None


def test_grid_of_another_board_is_found():
    picture, _ = photographed(parse_board("chessboard:9x6:24mm"))
    assert seen_grid(picture, (7, 5)) == (9, 6)


@pytest.mark.parametrize(
    ("spec", "paper"),
    [("chessboard:9x6:24mm", "A4"), ("charuco:7x5:40mm:30mm:DICT_4X4_50", "A3"), ("chessboard:20x12:50mm", "A0")],
)
def test_pdf_is_true_to_scale(tmp_path, spec, paper):
    board = parse_board(spec)
    target = tmp_path / "board.pdf"
    assert write_board_pdf(board, spec, target) == paper
    data = target.read_bytes()
    assert data.startswith(b"%PDF-1.4") and data.rstrip().endswith(b"%%EOF")
    start = int(data.split(b"startxref\n")[1].split(b"\n")[0])
    assert data[start:].startswith(b"xref")
    for line in data[start:].split(b"\n")[3:7]:  # every object is where the table says
        place = int(line.split()[0])
        assert data[place:].split(b" ", 2)[1:2] == [b"0"]
    rectangles = [line.split() for line in data.split(b"\n") if line.endswith(b" re")]
    widest = max(float(row[2]) for row in rectangles)
    assert widest == pytest.approx(board.square_m * 1000)  # the content is in millimetres
    assert b"2.8346456693 0 0 2.8346456693 0 0 cm" in data


def test_pdf_shows_the_markers_where_the_detector_expects_them(tmp_path):
    spec = "charuco:7x5:40mm:30mm:DICT_4X4_50"
    target = tmp_path / "board.pdf"
    write_board_pdf(parse_board(spec), spec, target)
    rows = [line.split()[:4] for line in target.read_bytes().split(b"\n") if line.endswith(b" re")]
    rectangles = np.array(rows, dtype=float)
    drawn = np.full((1200, 1700), 255, np.uint8)  # four pixels a millimetre, y up as on the page
    for x, y, width, height in rectangles * 4:
        drawn[round(y) : round(y + height), round(x) : round(x + width)] = 0
    view = find_board(np.ascontiguousarray(drawn[::-1]), parse_board(spec))
    assert view is not None
    assert len(view.ids) == 24


def test_board_larger_than_any_paper_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="A0"):
        write_board_pdf(parse_board("chessboard:20x12:90mm"), "x", tmp_path / "board.pdf")
    assert not list(tmp_path.iterdir())
