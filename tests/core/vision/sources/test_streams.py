"""Cameras on a network: one that stalls is told and done without, read again when it gives images, opened in time."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mjpeg_server import MjpegServer
from perfanim.core.errors import CaptureError
from perfanim.core.vision.sources import camera_source
from perfanim.core.vision.sources.addresses import is_stream
from perfanim.core.vision.sources.camera_source import CameraSource
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.vision.sources.pairing import ImagePairing
from perfanim.core.vision.sources.source_kinds import open_image_source
from perfanim.core.vision.sources.source_settings import SOURCES
from perfanim.core.worker.open_source import open_source

FPS = 60.0
NOISE = np.random.default_rng(5)


def pictures() -> list[Any]:
    """Noise that a JPEG keeps, and something bright."""
    images = [NOISE.integers(0, 40, (48, 64, 3), dtype=np.uint8) for _ in range(7)]
    for image in images:
        image[10:20, 20:30] = 220
    return images


@pytest.fixture
def servers() -> Iterator[list[MjpegServer]]:
    with MjpegServer(pictures(), FPS) as left, MjpegServer(pictures(), FPS) as right:
        yield [left, right]


def until(sets: Iterator[ImageSet], condition: Callable[[ImageSet], bool]) -> ImageSet:
    return next(s for _, s in zip(range(3000), sets, strict=False) if condition(s))


def test_stalled_stream_is_reported_and_skipped(servers: list[MjpegServer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_source, "SOURCES", replace(SOURCES, stream_stalls_ms=300))
    source = open_source({"kind": "videos", "paths": [server.address for server in servers], "fps": FPS})
    sets = iter(source)
    try:
        assert until(sets, lambda s: all(s.usable) and not s.notes)
        servers[1].begin("stream")
        assert until(sets, lambda s: bool(s.notes)).notes == ("the right camera froze",)
        # its connection is given up, and the left one goes on
        given_up = until(sets, lambda s: s.notes == ("the right camera is gone, check its cable",))
        assert given_up.usable == (True, False)
        servers[1].mend()
        assert until(sets, lambda s: all(s.usable) and not s.notes)
    finally:
        source.close()
    assert [server.opened > 1 for server in servers] == [False, True]


def test_cut_stream_is_reopened(servers: list[MjpegServer]) -> None:
    source = open_image_source(*(server.address for server in servers), fps=FPS)
    sets = iter(source)
    try:
        assert until(sets, lambda s: all(s.usable) and not s.notes)
        servers[1].begin("cut")
        assert until(sets, lambda s: bool(s.notes) and "the right camera is gone" in s.notes[0]).usable[0]
        servers[1].mend()
        assert until(sets, lambda s: all(s.usable) and not s.notes)
    finally:
        source.close()


def test_short_stall_keeps_the_connection(servers: list[MjpegServer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_source, "SOURCES", replace(SOURCES, stream_stalls_ms=60000))
    source = CameraSource([server.address for server in servers], fps=FPS)
    sets = iter(source)
    try:
        assert until(sets, lambda s: all(s.usable) and not s.notes)
        servers[1].begin("stream")
        assert until(sets, lambda s: bool(s.notes))
        servers[1].mend()
        assert until(sets, lambda s: all(s.usable) and not s.notes)
    finally:
        source.close()
    assert [server.opened for server in servers] == [1, 1]


def test_stream_without_answer_fails_quickly(servers: list[MjpegServer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_source, "SOURCES", replace(SOURCES, stream_opens_ms=200))
    servers[0].begin("stream")
    with pytest.raises(CaptureError, match=r"camera http://127.*does not open.*try the address"):
        open_image_source(servers[0].address)


def test_messages_do_not_contain_logins(
    servers: list[MjpegServer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Messages come into takes, and takes are given to others."""
    monkeypatch.setattr(camera_source, "SOURCES", replace(SOURCES, stream_opens_ms=200))
    servers[0].begin("stream")
    (tmp_path / "1.png").touch()
    address = servers[0].address.replace("://", "://anna:s3cr@t/1@")
    for sources in ([address], [address, address], [address, str(tmp_path)]):
        with pytest.raises(CaptureError, match="http://127") as caught:
            open_image_source(*sources)
        assert "anna" not in str(caught.value) and "s3cr" not in str(caught.value)


def test_address_of_a_film_is_not_a_camera(servers: list[MjpegServer]) -> None:
    kinds = {
        "http://studio/left.mjpg": True,
        "rtsp://studio/1?film=a.mp4": True,
        "rtsp://[studio": True,
        "HTTP://studio/left.MP4": False,
        "left.mjpg": False,
    }
    assert {text: is_stream(text) for text in kinds} == kinds
    with pytest.raises(CaptureError, match="is a camera, but another source is a video"):
        open_source({"kind": "videos", "paths": [servers[0].address, "left.mp4"]})


def test_rows_repeated_by_an_encoder_are_not_torn_images() -> None:
    def notes(compressed: tuple[bool, ...]) -> set[str]:
        pairing = ImagePairing([(480, 64, 3)], ["0"], 1.0 / FPS, 0.0, compressed)
        last, found = np.zeros((480, 64, 3), np.uint8), set()
        for frame in range(120):
            image = NOISE.integers(0, 255, last.shape, dtype=np.uint8)
            if frame in (90, 95):
                image[240:] = last[240:]
            last = image
            pairing.put(0, frame / FPS, image)
            taken = pairing.take(frame / FPS)
            found |= set(taken.notes if taken else ())
        return found

    assert notes((True,)) == set()
    assert "torn" in next(iter(notes((False,))))
