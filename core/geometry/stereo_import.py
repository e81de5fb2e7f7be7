"""Stereo calibrations of OpenCV and MATLAB: JSON, YAML, XML and MAT files.

No standard names their values, so they are found by the names that the documentation of both programs and common
scripts use: `K1`, `cameraMatrix1`, `mtxL`, `left_camera_matrix`, ... with `R` and `T` of x2 = R x1 + T.

- OpenCV: matrices of a `FileStorage` (YAML, XML or JSON), or lists of numbers.
- MATLAB's Stereo Camera Calibrator: `toStruct(stereoParams)` or the values of `stereoParametersToOpenCV`, in a MAT file
  up to version 7 or encoded as JSON. Older structures hold transposed matrices; principal points begin at pixel 1.
- Bouguet's toolbox: `Calib_Results_stereo.mat` with `fc_left`, `cc_left`, `kc_left`, `R` and `T`.
"""

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import CalibrationError
from ..system.file_content import decode_text
from ..system.files import reading
from . import rotations as rot
from .arrays import Array
from .mat_file import read_mat

_AGAIN = "export the stereo calibration with K, distortion, R and T"
_MOST_BYTES = 10_000_000
_SIDES = (("1", "2"), ("left", "right"), ("l", "r"), ("0", "1"))
_MATRIX = ("k", "m", "mtx", "matrix", "cameramatrix", "camera", "cammatrix", "intrinsicmatrix", "intrinsics")
_DISTORTION = ("d", "dist", "distortion", "distcoeffs", "distcoeff", "distcoef", "distortioncoefficients")
_ROTATION = ("r", "rot", "rotation", "rotationmatrix", "rotationofcamera2", "om")
_TRANSLATION = ("t", "trans", "translation", "translationvector", "translationofcamera2")
_SIZES = ("imagesize", "imgsize", "size", "resolution", "framesize")
_WIDTHS = (("width", "height"), ("imagewidth", "imageheight"), ("w", "h"), ("nx", "ny"))
_OWNERS = ("camera", "cam", "cameraparameters")
_USUAL_SIZES = tuple(
    turned
    for size in (
        (320, 240), (640, 360), (640, 480), (800, 600), (848, 480), (960, 540), (1024, 768), (1280, 720), (1280, 960),
        (1280, 1024), (1600, 1200), (1920, 1080), (1920, 1200), (2048, 1536), (2560, 1440), (2592, 1944), (3840, 2160),
    )
    for turned in (size, size[::-1])
)  # fmt: skip
_FARTHEST_CENTRE = 0.15  # largest offset of the principal point from the middle of an image of a guessed size

Numbers = dict[str, Array]


def is_stereo(raw: bytes, name: str) -> bool:
    """Return whether a file is a MAT, JSON or YAML file, or one of OpenCV's XML files."""
    head = raw[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    starts = (b"MATLAB", b"\x89HDF", b"{", b"%YAML")
    return head.startswith(starts) or b"<opencv_storage" in head or name.lower().endswith((".yml", ".yaml"))


def stereo_rows(raw: bytes, where: str) -> tuple[list[dict[str, Any]], str]:
    """Return the tables of the two cameras, the first one as the world, and the unit of length ("mm" or "unknown").

    Raises:
        CalibrationError: The file is damaged, or lacks a part of a stereo calibration.
    """
    numbers = _named_numbers(raw, where)
    sides = next((pair for pair in _SIDES if all(_matrix(numbers, side) is not None for side in pair)), None)
    if sides is None:
        raise CalibrationError("holds no two camera matrices", where=where, advice=_AGAIN)
    turn, shift = _find(numbers, _ROTATION, (9, 3)), _find(numbers, _TRANSLATION, (3,))
    in_mm = _find(numbers, tuple(f"{name}mm" for name in _TRANSLATION), (3,))
    if turn is None or (shift is None and in_mm is None):
        what = "does not say where the second camera is (R and T)"
        raise CalibrationError(what, where=where, advice="calibrate both cameras together, and export the result")
    rotation = rot.to_matrix(rot.from_rotation_vector(turn)) if turn.size == 3 else turn.reshape(3, 3)
    lenses = [_lens(numbers, side, where) for side in sides]
    if any(lens.pop("transposed") for lens in lenses):
        rotation = rotation.T
    placed = ((np.eye(3), np.zeros(3)), (rotation, in_mm if shift is None else shift))
    return [
        {"name": name, **lens, "rotation": place[0], "translation": place[1]}
        for name, lens, place in zip(("left", "right"), lenses, placed, strict=True)
    ], "mm" if shift is None else "unknown"


def _lens(numbers: Numbers, side: str, where: str) -> dict[str, Any]:
    matrix = _matrix(numbers, side)
    assert matrix is not None  # noqa: S101 - the sides were chosen by it
    # MATLAB's own structures: matrices for row vectors, and pixels that are counted from 1
    transposed = bool(np.any(matrix[2, :2]))
    matrix = matrix.T.copy() if transposed else matrix.copy()
    radial = _of_side(numbers, ("radialdistortion",), side, (2, 3))
    if radial is not None:
        tangential = _of_side(numbers, ("tangentialdistortion",), side, (2,))
        distortion = np.concatenate((radial[:2], np.zeros(2) if tangential is None else tangential, radial[2:]))
        matrix[:2, 2] -= 1.0
    else:
        found = _of_side(numbers, (*_DISTORTION, "kc"), side, (4, 5, 8, 12, 14))
        distortion = np.zeros(5) if found is None else found
    own = _of_side(numbers, _SIZES, side, (2, 3))
    size = _size(_find(numbers, _SIZES, (2, 3)) if own is None else own, numbers, matrix, where)
    return {"size": size, "matrix": matrix, "distortions": distortion, "transposed": transposed and radial is not None}


def _matrix(numbers: Numbers, side: str) -> Array | None:
    found = _of_side(numbers, _MATRIX, side, (9,))
    if found is not None:
        return found.reshape(3, 3)
    focal, centre = _of_side(numbers, ("fc",), side, (2,)), _of_side(numbers, ("cc",), side, (2,))
    if focal is None or centre is None:
        return None
    skew = _of_side(numbers, ("alphac",), side, (1,))
    shear = focal[0] * (0.0 if skew is None else skew[0])
    return np.array([[focal[0], shear, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])


def _size(found: Array | None, numbers: Numbers, matrix: Array, where: str) -> list[int]:
    """Return width and height; MATLAB's order is recognised by the principal point, which is near the middle."""
    named = next(([numbers[x][0], numbers[y][0]] for x, y in _WIDTHS if x in numbers and y in numbers), None)
    given = named if found is None else found[:2].tolist()
    sizes = _USUAL_SIZES if given is None else (tuple(given), tuple(given[::-1]))
    best = min(sizes, key=lambda size: _off_centre(matrix, size))
    if given is None and _off_centre(matrix, best) > _FARTHEST_CENTRE:
        raise CalibrationError(
            "does not state the size of the images", where=where, advice="add image_size: [width, height]"
        )
    return [int(number) for number in best]


def _off_centre(matrix: Array, size: tuple[float, ...]) -> float:
    return float(np.abs(matrix[:2, 2] / (0.5 * np.maximum(size, 1.0)) - 1.0).max())


def _of_side(numbers: Numbers, names: tuple[str, ...], side: str, lengths: tuple[int, ...]) -> Array | None:
    keys = [f"{name}{side}" for name in names] + [f"{side}{name}" for name in names]
    keys += [f"{owner}{key}" for owner in _OWNERS for key in keys]
    return _find(numbers, tuple(keys), lengths)


def _find(numbers: Numbers, names: tuple[str, ...], lengths: tuple[int, ...]) -> Array | None:
    return next((numbers[name] for name in names if name in numbers and numbers[name].size in lengths), None)


def _named_numbers(raw: bytes, where: str) -> Numbers:
    """Return all numbers of a file by name, in small letters and digits only, with the names of what holds them."""
    if raw.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise CalibrationError(
            "is a MATLAB file of version 7.3, which is not read", where=where, advice="save it with -v7"
        )
    if len(raw) > _MOST_BYTES:
        raise CalibrationError("is too large for a calibration", where=where, advice=_AGAIN)
    with reading(where, CalibrationError, _AGAIN, "is not a readable calibration"):
        found: dict[str, Array] = {}
        for names, values in _values(raw, where):
            key = re.sub(r"[^a-z0-9]", "", "".join(names).lower())
            found.setdefault(key, np.asarray(values, dtype=np.float64).ravel())
    return {key: numbers for key, numbers in found.items() if numbers.size and np.all(np.isfinite(numbers))}


def _values(raw: bytes, where: str) -> Iterator[tuple[list[str], Any]]:
    if raw.startswith(b"MATLAB"):
        yield from _leaves([], _inner(read_mat(raw)))
        return
    expected = "XML file" if raw.lstrip().startswith(b"<") else "calibration"
    text = decode_text(raw, where, expected, CalibrationError).strip().removeprefix("\ufeff")
    if text.startswith("{"):
        yield from _leaves([], _inner(json.loads(text)))
    elif text.startswith("<"):
        if "<!ENTITY" in text:
            raise ValueError("it defines entities")
        for element in ElementTree.fromstring(text):  # noqa: S314 - entities are refused above
            data = element.find("data")
            yield [element.tag], _numbers(element.text if data is None else data.text)
    else:
        for name, value in re.findall(r"^[\"']?(\w+)[\"']?:((?:.*)(?:\n[ \t-].*)*)", text, re.MULTILINE):
            yield [name], _numbers(value.partition("data:")[2] or value)


def _inner(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the table inside a file that holds nothing else."""
    own = [value for name, value in tables.items() if not name.startswith("__")]
    return own[0] if len(own) == 1 and isinstance(own[0], Mapping) else tables


def _leaves(names: list[str], value: Any) -> Iterator[tuple[list[str], Any]]:
    """Yield the numbers in nested tables, with their names; anything else is skipped."""
    if isinstance(value, Mapping):
        if "data" in value and "rows" in value:  # one of OpenCV's matrices
            yield names, value["data"]
            return
        for name, part in value.items():
            yield from _leaves([*names, str(name)], part)
    elif isinstance(value, int | float | list | np.ndarray):
        try:
            yield names, np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            return  # texts, or lists of unequal length


def _numbers(text: str | None) -> list[float]:
    """Return the numbers of a text; none if it contains anything else."""
    words = re.sub(r"[\[\],-](?=\s|$|\[)|[\[\],]", " ", text or "").split()
    try:
        return [float(word) for word in words]
    except ValueError:
        return []
