"""Frames that a camera leaves out are left out of the numbering too."""

import threading
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.vision.sources import camera_source, video_source
from perfanim.core.vision.sources.camera_source import CameraSource
from perfanim.core.vision.sources.image_set import next_number
from perfanim.core.vision.sources.source_settings import SOURCES
from perfanim.core.vision.sources.video_source import VideoSource

PICTURE = np.zeros((48, 64, 3), np.uint8)


class PlayedCapture:
    """A camera or video of 60 Hz whose frames come at given times, and the clock that shows them."""

    def __init__(self, times_s: list[float]) -> None:
        self.times_s = times_s
        self.now_s = 0.0
        self.taken = 0

    def perf_counter(self) -> float:
        return self.now_s

    def grab(self) -> bool:
        if self.taken == len(self.times_s):
            return False
        self.now_s = self.times_s[self.taken]
        self.taken += 1
        return True

    def retrieve(self) -> tuple[bool, Any]:
        return True, PICTURE

    def read(self) -> tuple[bool, Any]:
        return (True, PICTURE) if self.grab() else (False, None)

    def get(self, key: int) -> float:
        return {cv2.CAP_PROP_FPS: 60.0, cv2.CAP_PROP_POS_MSEC: 1000.0 * self.now_s}.get(key, len(self.times_s))

    def release(self) -> None:
        pass


# the camera is a little early or late each time, and leaves out 4 and 5, then 10
KEPT = [0, 1, 2, 3, 6, 7, 8, 9, 11, 12]
LATE_S = [0.0, 0.004, -0.003, 0.002, 0.003, -0.004, 0.0, 0.002, 0.004, -0.003]
TIMES_S = [number / 60 + late for number, late in zip(KEPT, LATE_S, strict=True)]


def test_late_frame_is_not_a_lost_frame() -> None:
    assert [next_number(7, periods / 60, 1 / 60) for periods in (0.2, 1.0, 1.49, 1.6, 2.4, 2.6, 5.1)] == [
        8, 8, 8, 9, 9, 10, 12
    ]  # fmt: skip


def test_camera_frames_are_numbered_by_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    played = PlayedCapture(TIMES_S)
    monkeypatch.setattr(camera_source, "_open", lambda *_: (played, PICTURE))
    monkeypatch.setattr(camera_source, "time", played)
    source = CameraSource([0])
    numbers = [image_set.number for _, image_set in zip(KEPT, source, strict=False)]
    source.close()
    assert numbers == KEPT


@pytest.mark.parametrize(("held", "second"), [(SOURCES.held, KEPT[1]), (1, KEPT[-1])])
def test_images_that_wait_are_dropped_where_only_the_newest_counts(
    held: int, second: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = threading.Event()

    class Waiting(PlayedCapture):
        def grab(self) -> bool:
            if self.taken == 1:
                more.wait()
            return super().grab()

    played = Waiting(TIMES_S)
    monkeypatch.setattr(camera_source, "_open", lambda *_: (played, PICTURE))
    monkeypatch.setattr(camera_source, "time", played)
    source = CameraSource([0], held=held)
    sets = iter(source)
    assert next(sets).number == 0
    more.set()  # while this set is processed, the other images come
    while played.taken < len(TIMES_S):
        time.sleep(0.001)
    assert next(sets).number == second
    source.close()


def test_video_frames_are_numbered_by_time_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_source, "_open", lambda _: PlayedCapture(TIMES_S))
    sets = list(VideoSource([Path("left.mkv"), Path("right.mkv")]))
    assert [image_set.number for image_set in sets] == KEPT
    np.testing.assert_allclose([image_set.times_s[0] for image_set in sets], np.array(KEPT) / 60)


def test_video_of_a_variable_rate_has_the_times_of_its_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    stamps_s = np.cumsum(np.random.default_rng(3).uniform(0.010, 0.070, 40)).tolist()
    monkeypatch.setattr(video_source, "_open", lambda _: PlayedCapture(stamps_s))
    sets = list(VideoSource([Path("left.mkv"), Path("right.mkv")]))
    assert len(sets) == 40 and all(all(image_set.usable) for image_set in sets)
    away_s = np.array([image_set.times_s[1] for image_set in sets]) - (np.array(stamps_s) - stamps_s[0])
    assert np.abs(away_s).max() < 0.25 / 60
    assert np.all(np.diff([image_set.number for image_set in sets]) > 0)


class PlayedVideo(PlayedCapture):
    """A video with pictures: of each moment another, but doubled ones."""

    def __init__(self, numbers: list[int], doubled: tuple[int, ...] = ()) -> None:
        super().__init__([number / 60 for number in numbers])
        self.shown = [number - (number in doubled) for number in numbers]

    def read(self) -> tuple[bool, Any]:
        return (True, np.full((48, 64, 3), self.shown[self.taken - 1], np.uint8)) if self.grab() else (False, None)

    def get(self, key: int) -> float:
        return 20 if key == cv2.CAP_PROP_FRAME_COUNT else super().get(key)  # estimated from the duration, as in .mkv


def test_frame_lost_or_repeated_in_one_video_is_unusable_there_only(monkeypatch: pytest.MonkeyPatch) -> None:
    left = [n for n in range(20) if n != 9]
    right = [n for n in range(20) if n not in (4, 5, 9)]
    monkeypatch.setattr(
        video_source, "_open", lambda path: PlayedVideo(left) if "left" in path else PlayedVideo(right, doubled=(12,))
    )
    source = VideoSource([Path("left.mkv"), Path("right.mkv")])
    sets = list(source)
    assert [s.number for s in sets] == left
    for image_set in sets:
        whole = image_set.number not in (4, 5, 12)
        assert image_set.usable == (True, whole)
        shown = [int(image[0, 0, 0]) for image in image_set.images]
        assert shown == [image_set.number, image_set.number if whole else 0]
    assert source.warnings == (
        "right.mkv shows 1 frame twice: repeats were left out",
        "right.mkv lacks 2 frames that another video has",
    )


def test_last_frame_may_be_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = list(range(20))
    monkeypatch.setattr(video_source, "_open", lambda path: PlayedVideo(whole[:19] if "left" in path else whole))
    assert [s.number for s in VideoSource([Path("left.mkv"), Path("right.mkv")])] == whole[:19]
    monkeypatch.setattr(video_source, "_open", lambda path: PlayedVideo(whole[:15] if "left" in path else whole))
    with pytest.raises(CaptureError, match=r"left\.mkv: ends after 15 frames, before another video"):
        list(VideoSource([Path("left.mkv"), Path("right.mkv")]))


def test_still_videos_are_usable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_source, "_open", lambda _: PlayedVideo(list(range(20)), doubled=(7, 8)))
    source = VideoSource([Path("left.mkv"), Path("right.mkv")])
    assert all(all(image_set.usable) for image_set in source)
    assert source.warnings == ()
