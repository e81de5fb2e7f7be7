"""Numbers in MAT files, as SciPy writes and reads them."""

import contextlib
import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from perfanim.core.geometry.mat_file import read_mat
from scipy.io import loadmat, savemat

VALUES: dict[str, Any] = {
    "x": 3.5,
    "matrix": np.arange(6.0).reshape(2, 3),
    "whole": np.array([[1, -2], [300, 4]], dtype=np.int16),
    "small": np.float32([0.5, 2.0]),
    "flags": np.array([True, False]),
    "text": "millimetres",
    "none": np.zeros((0, 3)),
    "cells": np.array([np.arange(3.0), 2.0], dtype=object),
    "camera": {"K": np.eye(3), "inner": {"size": np.array([720, 1280]), "name": "left"}},
    "many": np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("a", object), ("b", object)]),
}


def written(compressed: bool) -> bytes:
    file = io.BytesIO()
    savemat(file, VALUES, do_compression=compressed)
    return file.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_are_those_that_were_written(compressed: bool) -> None:
    raw = written(compressed)
    found, expected = read_mat(raw), loadmat(io.BytesIO(raw))
    for name in ("x", "matrix", "whole", "small", "flags", "none"):
        np.testing.assert_array_equal(found[name], expected[name])
    assert found["text"] is None
    assert [cell.ravel().tolist() for cell in found["cells"]] == [[0.0, 1.0, 2.0], [2.0]]
    np.testing.assert_array_equal(found["camera"]["K"], np.eye(3))
    assert found["camera"]["inner"]["size"].ravel().tolist() == [720.0, 1280.0]
    assert [{name: value.item() for name, value in row.items()} for row in found["many"]] == [
        {"a": 1.0, "b": 2.0}, {"a": 3.0, "b": 4.0}
    ]  # fmt: skip


def test_what_holds_the_contents_of_objects_is_no_variable() -> None:
    """MATLAB appends it, as bytes without a name."""
    file = io.BytesIO()
    savemat(file, {"x": np.zeros(3, dtype=np.uint8)})
    appended = file.getvalue()[128:].replace(struct.pack("<HH4s", 1, 1, b"x"), struct.pack("<2I", 1, 0))
    found = read_mat(written(False) + appended)
    assert list(found) == list(VALUES)
    assert found["x"] == 3.5


def test_a_file_that_ends_early_or_is_damaged_raises_only_what_is_documented() -> None:
    for raw in (written(False), written(True)):
        for end in range(0, len(raw), 7):
            attempt(raw[:end])
        damaged = np.frombuffer(raw, np.uint8).copy()
        rng = np.random.default_rng(0)
        for _ in range(500):
            changed = damaged.copy()
            changed[rng.integers(128, len(raw), 3)] = rng.integers(0, 256, 3)
            attempt(changed.tobytes())


def attempt(raw: bytes) -> None:
    with contextlib.suppress(ValueError, OverflowError, IndexError, struct.error, zlib.error):
        read_mat(raw)


def test_what_unpacks_to_more_than_a_calibration_is_refused() -> None:
    header = written(False)[:128]
    bomb = zlib.compress(struct.pack("<2I", 14, 1 << 31) + bytes(20_000_000))
    with pytest.raises(ValueError, match="longer than its file"):
        read_mat(header + struct.pack("<2I", 15, len(bomb)) + bomb)
