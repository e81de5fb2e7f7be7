"""Sizes of pictures by their headers: as OpenCV reads them, for every kind, and none that takes far too much memory."""

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.vision.sources.file_endings import IMAGE_SUFFIXES
from perfanim.core.vision.sources.image_files import read_image
from perfanim.core.vision.sources.image_header import check_image_size, image_size

IMAGE = np.tile(np.arange(50, dtype=np.uint8)[:, None, None], (1, 37, 3))


def encoded(ending: str, *options: int, image: np.ndarray = IMAGE) -> bytes:
    return cv2.imencode(ending, image, options)[1].tobytes()


KINDS = {ending: encoded(ending) for ending in IMAGE_SUFFIXES if ending != ".pgm"} | {
    ".pgm": encoded(".pgm", image=IMAGE[..., 0]),
    "progressive": encoded(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "lossless": encoded(".webp", cv2.IMWRITE_WEBP_QUALITY, 101),
    "transparent": encoded(".webp", image=np.dstack((IMAGE, IMAGE[..., 0]))),
    "grey": encoded(".png", image=IMAGE[..., 0]),
    "deep": encoded(".tif", image=IMAGE.astype(np.uint16)),
    "text": b"P3 # 9 9\n#8\n37\t50 255\n" + b"1 2 3 " * 37 * 50,
    "old BMP": b"BM" + bytes(8) + struct.pack("<IIHHHH", 26, 12, 37, 50, 1, 24) + bytes(112 * 50),
    "upside down": b"BM" + bytes(8) + struct.pack("<IIiiHH", 54, 40, 37, -50, 1, 24) + bytes(24 + 112 * 50),
    "filled": b"\xff\xd8\xff\xff\xff\xfe\0\4\xff\xc0" + encoded(".jpg")[2:],
}


@pytest.mark.parametrize("data", KINDS.values(), ids=KINDS)
def test_size_from_the_header_equals_the_images(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(data)
    assert read_image(tmp_path / "a.png").shape == (50, 37, 3)
    assert image_size(data) == (37, 50)
    for stop in range(40):
        try:
            image_size(data[:stop])
        except ValueError:
            continue


def bomb(side: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    rows = zlib.compress(bytes((side + 1) * side), 9)
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


WHOLE = KINDS[".png"]
START = WHOLE.index(b"IDAT") - 4
CASES = {
    "pixels": (None, "has 12000 x 12000 pixels, far more than its data can hold; use smaller images"),
    "a part": (WHOLE[:START] + b"\x70\0\0\0" + WHOLE[START + 4 :], "not a readable image (cut off in its part"),
    "a part behind the end": (
        WHOLE.replace(b"IDAT", b"I\0\0\0") + b"\x70\0\0\0IDAT",
        "not a readable image (not a picture)",
    ),
}


@pytest.mark.parametrize(("data", "message"), CASES.values(), ids=CASES)
def test_small_file_with_huge_declared_size_takes_no_memory(data: bytes | None, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(bomb(12_000) if data is None else data)
    program = (
        "import resource, sys; from pathlib import Path\n"
        "from perfanim.core.vision.sources.image_files import read_image\n"
        "from perfanim.core.errors import CaptureError; before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: read_image(Path(sys.argv[1]))\n"
        "except CaptureError as error: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, error)"
    )
    line = [sys.executable, "-c", program, str(tmp_path / "a.png")]
    taken_kb, told = subprocess.run(line, capture_output=True, text=True, check=True).stdout.split(maxsplit=1)
    assert message in told
    if sys.platform == "linux":
        assert int(taken_kb) < 16 << 10


def test_pictures_of_real_cameras_are_accepted() -> None:
    check_image_size((5472, 3648), 0, "a dark one of 20 million pixels")
    check_image_size((7680, 4320), 10_000_000, "one of 8K")
    with pytest.raises(CaptureError, match="16384 x 16384"):
        check_image_size((16_384, 16_384), 100_000_000, "a")
