"""Image files: search, ordering by number, pairing between cameras, reading and writing."""

import glob
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...system.file_content import check_kind
from ...system.files import atomic_path, is_file, is_folder, read_bytes, reading
from .file_endings import IMAGE_SUFFIXES
from .image_header import check_image_size, image_size


def list_images(pattern: str | Path) -> list[Path]:
    """Return the image files of a folder or a glob, or one file, ordered by number."""
    text = os.path.expanduser(str(pattern))  # noqa: PTH111 - a glob need not be a valid path
    path = Path(text)
    if is_folder(text):
        found = [p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".")]
    elif is_file(path):
        found = [path] if path.suffix.lower() in IMAGE_SUFFIXES else []
    else:
        found = [Path(p) for p in glob.glob(text, recursive=True)]  # noqa: PTH207 - absolute patterns too
        found = [p for p in found if is_file(p) and p.suffix.lower() in IMAGE_SUFFIXES]
    if not found:
        raise CaptureError("no image files found", where=text, advice="give a folder or a pattern like left/*.jpg")
    return sorted(found, key=natural_key)


def natural_key(path: Path) -> tuple[tuple[int, int, str], ...]:
    """Return a key that orders by the numbers in a name (9 before 10), then by its text."""
    parts = re.split(r"(\d+)", path.name)
    return tuple((1, int(part), "") if part.isdecimal() else (2, 0, part) for part in parts if part)


def pair_by_number(lists: Sequence[Sequence[Path]]) -> tuple[list[tuple[int, tuple[Path, ...]]], list[Path]]:
    """Return the files of several cameras by number, ascending, and the unpaired files."""
    tables = by_number(lists)
    shared = sorted(set.intersection(*(set(table) for table in tables)))
    pairs = [(number, tuple(table[number] for table in tables)) for number in shared]
    used = {path for _, paths in pairs for path in paths}
    return pairs, [path for paths in lists for path in paths if path not in used]


def by_number(lists: Sequence[Sequence[Path]]) -> list[dict[int, Path]]:
    """Return each camera's files by the number in their names; files of one moment share a number.

    If names contain several numbers (first, second, ...), the one whose values most files share with another camera's
    files is used. Without common numbers, lists of equal length are numbered in order.

    Raises:
        CaptureError: There are no common numbers, and the lists have different lengths.
    """
    numbers = [[[int(text) for text in re.findall(r"\d+", path.stem)] for path in paths] for paths in lists]
    width = max((len(row) for rows in numbers for row in rows), default=0)
    best: list[dict[int, Path]] = []
    most = 0
    for position in range(width):
        tables = [_table(paths, rows, position) for paths, rows in zip(lists, numbers, strict=True)]
        counts = Counter(number for table in tables for number in table)
        shared = sum(count > 1 for count in counts.values())
        if shared > most:
            best, most = tables, shared
    lengths = [len(paths) for paths in lists]
    if most > 1 or (most == 1 and max(lengths) == 1):
        return best
    if len(set(lengths)) != 1:
        raise CaptureError(
            "the cameras have " + " and ".join(map(str, lengths)) + " pictures and no numbers in common",
            where=str(lists[0][0].parent),
            advice="give pictures taken at the same moment the same number, e.g. left012.jpg and right012.jpg",
        )
    return [dict(enumerate(paths)) for paths in lists]


def _table(paths: Sequence[Path], rows: Sequence[Sequence[int]], position: int) -> dict[int, Path]:
    counts = Counter(row[position] for row in rows if len(row) > position)
    return {
        row[position]: path
        for path, row in zip(paths, rows, strict=True)
        if len(row) > position and counts[row[position]] == 1
    }


def write_image(path: Path | str, image: Image) -> None:
    """Write an image (BGR) to a file whose extension determines the format."""
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), image):
            raise CaptureError("cannot be written", where=str(path), advice="check the free disk space")


def read_image(path: Path) -> Image:
    """Return a BGR image; small files that declare very many pixels are rejected."""
    with reading(path, CaptureError, "export it again", "is not a readable image"):
        data = read_bytes(path, 128 << 20, CaptureError)  # cv2.imread cannot open every path on Windows
        check_kind(data, str(path), "picture", CaptureError)
        check_image_size(image_size(data), len(data), str(path))
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise ValueError("damaged")
    return np.asarray(image, dtype=np.uint8)


def open_address(text: str, opening_ms: int, reading_ms: int) -> Any:
    """Return a capture for an address, with limits on the time to open it and to wait for an image."""
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, opening_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, reading_ms]
    return cv2.VideoCapture(text, cv2.CAP_FFMPEG, limits)
