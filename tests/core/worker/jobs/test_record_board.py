"""The cameras calibrated from a board, and the floor found, by the real worker."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from jobs_played import outcome, played, said
from perfanim.core.errors import CalibrationError, CaptureError
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rig_file import rig_from, rig_tables
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, board_on_floor, board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.sources.image_files import read_image
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.worker.jobs import record_board, record_floor
from perfanim.core.worker.protocol import Message, MessageKind, encode_preview
from perfanim.core.worker.requests import read_request


def asked(source: dict[str, Any], folder: Path, **more: Any) -> dict[str, Any]:
    request = {"job": "record board", "source": source, "board": "chessboard:9x6:80mm", "limit": 40}
    return {**request, "every_s": None, "out": str(folder), **more}


class PlayedSource(list[ImageSet]):
    """Image sets as a source."""

    def close(self) -> None:
        self.clear()


@pytest.fixture
def blank(tmp_path: Path) -> dict[str, Any]:
    """A source of nine moments that show nothing."""
    for side in ("l", "r"):
        (tmp_path / side).mkdir()
        for number in range(9):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), np.full((120, 160, 3), 90, np.uint8))
    return {"kind": "images", "paths": [str(tmp_path / "l"), str(tmp_path / "r")], "fps": 5.0}


@pytest.mark.long
def test_views_are_taken_until_it_is_told_to_finish(tmp_path: Path) -> None:
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / "old.png").touch()

    def four_views(message: Message) -> bool:
        return message.kind is MessageKind.STATUS and message.status().views == 4

    messages = played(asked({"kind": "simulated"}, tmp_path, preview=True), four_views)
    result = outcome(messages).json()
    assert "hold it still" in said(messages)
    assert any(text.startswith("taken, move it to the ") for text in said(messages))
    taken = result["used"]
    assert taken >= 4
    assert taken >= 8 or any(f"{taken} moments" in advice for advice in result["advice"])  # too few to be sure
    assert not any("too small" in advice for advice in result["advice"])
    found, true = rig_from(result["rig"], "result"), default_rig()
    assert found.baseline_m() == pytest.approx(true.baseline_m(), rel=3 * result["distance_sigma_percent"] / 100.0)
    for side in ("left", "right"):
        assert sorted(p.name for p in (tmp_path / side).iterdir()) == [f"{i:03d}.png" for i in range(taken)]
        assert read_image(tmp_path / side / "003.png").shape == (480, 640, 3)

    pictures = [m.preview() for m in messages if m.kind is MessageKind.PREVIEW]
    assert {picture.shape for picture in pictures} == {(240, 640, 3)}
    # red, green, blue: what has been covered is green
    greener = [float(np.mean(p[..., 1].astype(float) - p[..., 0])) for p in pictures]
    assert greener[-1] > greener[0] + 2.0


@pytest.mark.long
def test_a_board_that_is_too_small_is_told_of_each_camera(tmp_path: Path) -> None:
    for picture in board_pictures(Renderer(default_rig()), DEFAULT_BOARD, 4):
        for side, image in zip(("l", "r"), picture.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            small = cv2.resize(image, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
            for moment in range(12):  # it is held still
                cv2.imwrite(str(tmp_path / side / f"{picture.number:02d}-{moment:02d}.png"), small)
    source = {"kind": "images", "paths": [str(tmp_path / "l"), str(tmp_path / "r")], "fps": 10.0}
    result = outcome(played(asked(source, tmp_path / "board", limit=4))).json()
    told = [advice for advice in result["advice"] if "the board is too small in" in advice]
    assert len(told) == 2
    assert "the left camera" in told[0]
    assert "the right camera" in told[1]


def test_pictures_without_the_board_are_an_error_that_says_so(blank: dict[str, Any], tmp_path: Path) -> None:
    messages = played(asked(blank, tmp_path / "board"))
    assert "was seen whole and still in 0 places, but 3 are needed" in str(outcome(messages).error())
    assert "show the whole board to all cameras" in said(messages)
    assert not list((tmp_path / "board").rglob("*.png"))
    assert not [m for m in messages if m.kind is MessageKind.PREVIEW]  # nobody asked for it


def test_a_countdown_goes_before_timed_views(blank: dict[str, Any], tmp_path: Path) -> None:
    told = said(played(asked(blank, tmp_path / "board", every_s=1.0)))
    assert told.index("1: show the whole board to all cameras") < told.index("show the whole board to all cameras")


def test_what_is_wrong_with_a_camera_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    black = (np.zeros((120, 160, 3), np.uint8),) * 2
    note = "the left camera froze 2 s ago: trying again"
    moments = [
        ImageSet(0, (np.nan, np.nan), black, ("no camera gives images",), (False, False)),
        ImageSet(1, (np.nan, 0.5), black, (note,), (False, True)),
    ]
    for name, job in (("record board", record_board), ("record floor", record_floor)):
        told: list[str] = []
        channel: Any = SimpleNamespace(
            stop_requested=threading.Event(), send_status=lambda text, *_, told=told, **__: told.append(text)
        )
        monkeypatch.setattr(record_board, "open_source", lambda _spec: PlayedSource(moments))
        with pytest.raises(CalibrationError):
            table = asked({"kind": "cameras", "devices": [0, 1]}, tmp_path) | {"rig": rig_tables(default_rig())}
            job.run(read_request(name, table), channel)
        assert "no camera gives images" in told
        assert note in told


def test_the_floor_is_where_the_board_lies(tmp_path: Path) -> None:
    true = default_rig()
    shift = np.array([0.3, -0.2, 0.1])  # of the world that the calibration is in
    elsewhere = CameraRig(
        tuple(
            Camera(c.name, c.image_size, c.matrix, c.distortion, c.rotation, c.translation_m + c.rotation @ shift)
            for c in true.cameras
        )
    )
    request = {"job": "record floor", "source": {"kind": "simulated"}, "board": "chessboard:9x6:80mm"}
    result = outcome(played({**request, "rig": rig_tables(elsewhere)})).json()
    assert result["scale"] == pytest.approx(1.0, abs=0.005)
    found = rig_from(result["rig"], "result")
    assert found.metadata["floor"] == "y = 0"
    _, before_m = board_on_floor()
    # corners known to 0.1 px are 1 mm off in depth; over 54 of them on 0.64 m x 0.4 m the floor tilts by 1 mrad,
    # which is 3 mm at the cameras; five times that
    for camera, other in zip(found.cameras, true.cameras, strict=True):
        np.testing.assert_allclose(camera.centre_m, other.centre_m - [0.0, 0.0, before_m], atol=0.015)


def test_pictures_travel_whole() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (3, 5, 3)).astype(np.uint8)
    payload = encode_preview(picture)[8:]
    np.testing.assert_array_equal(Message(MessageKind.PREVIEW, payload).preview(), picture)
    for broken in (Message(MessageKind.PREVIEW, payload[:-1]), Message(MessageKind.PREVIEW), Message(MessageKind.END)):
        with pytest.raises(CaptureError):
            broken.preview()
