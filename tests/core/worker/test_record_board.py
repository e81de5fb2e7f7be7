"""Recording the board for the calibration, by the real worker."""

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.sources.files import read_image
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import Message, MessageKind

PATIENCE_S = 120.0


def outcome(request: dict[str, Any]) -> tuple[Message, list[str]]:
    """Return the result or error of a recording, and what it said meanwhile."""
    client, messages = WorkerClient({"job": "record board", **request}), []
    limit = time.monotonic() + PATIENCE_S
    try:
        while not client.ended:
            messages += client.poll()
            client.wait(0.05)
            assert time.monotonic() < limit
    finally:
        client.close()
    said = [str(m.json()["activity"]) for m in messages if m.kind is MessageKind.STATUS]
    (last,) = [m for m in messages if m.kind in (MessageKind.RESULT, MessageKind.ERROR)]
    return last, said


@pytest.fixture
def blank(tmp_path: Path) -> dict[str, Any]:
    """A source of nine moments that show nothing."""
    for side in ("l", "r"):
        (tmp_path / side).mkdir()
        for number in range(9):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), np.full((120, 160, 3), 90, np.uint8))
    return {"kind": "images", "paths": [str(tmp_path / "l"), str(tmp_path / "r")]}


def test_pictures_are_kept_when_both_cameras_see_the_board(tmp_path: Path) -> None:
    request = {"source": {"kind": "simulated"}, "board": "chessboard:9x6:80mm", "pictures": 3}
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / "old.png").touch()
    last, said = outcome({**request, "every_s": 5.0, "out": str(tmp_path)})
    assert last.kind is MessageKind.RESULT
    assert last.json()["pictures"] == 3
    assert "3 of 3 taken, move the board" in said
    for side in ("left", "right"):
        assert sorted(p.name for p in (tmp_path / side).iterdir()) == ["000.png", "001.png", "002.png"]
        assert read_image(tmp_path / side / "002.png").shape == (480, 640, 3)


def test_pictures_without_the_board_are_an_error_that_says_so(blank: dict[str, Any], tmp_path: Path) -> None:
    request = {"source": blank, "board": "chessboard:9x6:24mm", "pictures": 3, "every_s": 0.0}
    last, said = outcome({**request, "out": str(tmp_path / "board")})
    assert "both cameras saw the board in 0 of 9 pictures" in str(last.error())
    assert "not seen: left and right" in said
    assert not list((tmp_path / "board").rglob("*.png"))


def test_there_is_time_to_move_the_board(blank: dict[str, Any], tmp_path: Path) -> None:
    request = {"source": blank, "board": "chessboard:9x6:24mm", "pictures": 3, "every_s": 30.0}
    last, said = outcome({**request, "out": str(tmp_path / "board")})
    assert "in 0 of 0 pictures" in str(last.error())  # the images were over before the first was due
    assert "30: hold the board still" in said
