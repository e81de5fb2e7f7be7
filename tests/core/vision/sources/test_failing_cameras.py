"""Cameras that freeze, vanish, go black or repeat an image: told within a quarter of a second, done without, back."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.vision.sources import camera_source
from perfanim.core.vision.sources.camera_source import CameraSource
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.vision.sources.pairing import ImagePairing
from perfanim.core.vision.sources.source_settings import SOURCES

FPS = 60.0
NOTICED_S = 0.25
SHAPE = (48, 64, 3)
NOISE = np.random.default_rng(5)


def picture() -> Any:
    """What a sensor gives: noise, and something bright."""
    image = NOISE.integers(0, 12, SHAPE, dtype=np.uint8)
    image[10:14, 20:24] = 220
    return image


def played(script: Callable[[int, float], Any], seconds: float, phases_s: tuple[float, ...]) -> list[ImageSet]:
    """Return the sets that come of cameras of 60 Hz: `script` gives a camera's image of a moment, None for none."""
    pairing = ImagePairing([SHAPE] * len(phases_s), ["0", "1", "2"][: len(phases_s)], 1.0 / FPS, 0.0)
    sets = []
    arrivals = sorted(
        (phase + frame / FPS, camera) for camera, phase in enumerate(phases_s) for frame in range(int(seconds * FPS))
    )
    for now_s in np.arange(0.0, seconds, 0.005):
        while arrivals and arrivals[0][0] <= now_s:
            moment_s, camera = arrivals.pop(0)
            image = script(camera, moment_s)
            if image is not None:
                pairing.put(camera, moment_s, image)
        while (taken := pairing.take(now_s)) is not None:
            sets.append(taken)
            assert now_s - min(taken.times_s) < 0.06  # nobody waits long for a camera that may not come
    return sets


FAILS_S, BACK_S = 1.0, 2.0


def failing(kind: str) -> Callable[[int, float], Any]:
    """The second camera fails for a second."""
    last = picture()

    def image(camera: int, moment_s: float) -> Any:
        nonlocal last
        if camera != 1 or not FAILS_S <= moment_s < BACK_S:
            shown = picture()
            last = shown if camera == 1 else last
            return shown
        if kind == "size":
            return picture()[::2, ::2]
        if kind == "black":
            return NOISE.integers(0, 12, SHAPE, dtype=np.uint8)
        return last if kind == "repeats" else None

    return image


@pytest.mark.parametrize(
    ("kind", "told"),
    [("froze", "froze"), ("black", "is black"), ("repeats", "repeats one"), ("size", "gives images of another size")],
)
@pytest.mark.parametrize("phase_s", [0.0, 0.004, 0.012])
def test_failing_camera_is_reported_skipped_and_used_again(kind: str, told: str, phase_s: float) -> None:
    sets = played(failing(kind), 3.0, (0.0, phase_s))
    moments = np.array([s.times_s[0] for s in sets])
    assert not any(s.notes for s, moment in zip(sets, moments, strict=True) if moment < FAILS_S)
    first = next(s for s in sets if s.notes)
    assert first.times_s[0] < FAILS_S + NOTICED_S
    assert first.notes[0].startswith("the right camera " + told)
    # the left camera's images all come, the right one's are no longer used
    missing = [s for s in sets if not all(s.usable)]
    assert all(s.usable[0] for s in sets)
    assert not any(s.usable[1] for s, t in zip(sets, moments, strict=True) if FAILS_S + 0.02 < t < BACK_S - 0.03)
    assert all(not s.images[1].any() for s in missing)
    assert len(missing) == pytest.approx((BACK_S - FAILS_S) * FPS, abs=3)
    assert [s.number for s in sets] == list(range(len(sets)))
    assert len(sets) == pytest.approx(3.0 * FPS, abs=3)
    after = [s for s, moment in zip(sets, moments, strict=True) if moment > BACK_S + 0.05]
    assert all(all(s.usable) and not s.notes for s in after)


def test_repeated_image_is_not_used_and_not_reported() -> None:
    last: dict[int, Any] = {}

    def image(camera: int, moment_s: float) -> Any:
        if not (camera == 0 and abs(moment_s - 0.5) < 0.5 / FPS):
            last[camera] = picture()
        return last[camera]

    sets = played(image, 1.0, (0.0, 0.003))
    assert sum(not s.usable[0] for s in sets) == 1
    assert not any(s.notes for s in sets)


def test_dark_scene_is_not_a_black_camera() -> None:
    def image(camera: int, moment_s: float) -> Any:
        return NOISE.integers(0, 12, SHAPE, dtype=np.uint8)

    assert all(all(s.usable) and not s.notes for s in played(image, 1.0, (0.0, 0.0)))


@pytest.mark.parametrize(("rates", "told"), [((60.0, 240.0), True), ((120.0, 120.0), False), ((60.0, 60.0), False)])
def test_camera_of_another_rate_is_reported_but_not_a_wrong_rate_of_all(rates: tuple[float, float], told: bool) -> None:
    pairing = ImagePairing([SHAPE, SHAPE], ["0", "1"], 1.0 / FPS, 0.0)
    sets = []
    for moment_s, camera in sorted((f / rate, at) for at, rate in enumerate(rates) for f in range(int(rate))):
        pairing.put(camera, moment_s, picture())
        while (taken := pairing.take(moment_s)) is not None:
            sets.append(taken)
    notes = {note for s in sets for note in s.notes}
    assert notes == ({"the right camera gives images too often, set all cameras to one rate"} if told else set())
    first = next((s for s in sets if s.notes), None)
    assert first is None or first.times_s[1] < NOTICED_S


def test_cameras_of_slightly_different_rate_stay_paired() -> None:
    pairing = ImagePairing([SHAPE, SHAPE], ["0", "1"], 1.0 / FPS, 0.0)
    arrivals = sorted([(f / 60.0, 0) for f in range(1200)] + [(f / 59.5, 1) for f in range(1190)])
    sets = []
    for moment_s, camera in arrivals:
        pairing.put(camera, moment_s, picture())
        while (taken := pairing.take(moment_s)) is not None:
            sets.append(taken)
    apart = [abs(s.times_s[0] - s.times_s[1]) for s in sets if all(s.usable)]
    assert max(apart) <= 0.76 / FPS
    assert sum(not all(s.usable) for s in sets) <= 11  # one for each period that the slower camera falls behind
    assert not any(s.notes for s in sets)


class Device:
    """A camera of 100 Hz whose cable is pulled, or whose driver hangs, at the test's will."""

    def __init__(self) -> None:
        self.plugged = threading.Event()
        self.answers = threading.Event()
        self.plugged.set()
        self.answers.set()

    def open(self, *_: Any) -> tuple[Any, Any]:
        if not self.plugged.is_set():
            raise CaptureError("does not open")
        return self, picture()

    def grab(self) -> bool:
        self.answers.wait()
        time.sleep(0.01)
        return self.plugged.is_set()

    def retrieve(self) -> tuple[bool, Any]:
        return True, picture()

    def get(self, key: int) -> float:
        return 100.0 if key == cv2.CAP_PROP_FPS else 0.0

    def release(self) -> None:
        pass


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Device]]:
    both = [Device(), Device()]
    monkeypatch.setattr(camera_source, "_open", lambda device, *_: both[device].open())
    yield both
    for device in both:
        device.answers.set()


def test_pulled_cable_and_hung_driver_do_not_delay_other_cameras(devices: list[Device]) -> None:
    source = CameraSource([0, 1])
    stages = [(devices[1].plugged, "the right camera is gone"), (devices[1].answers, "the right camera froze")]
    sets = iter(source)

    def until(condition: Callable[[ImageSet], bool]) -> ImageSet:
        return next(s for _, s in zip(range(3000), sets, strict=False) if condition(s))

    try:
        for event, told in stages:
            assert until(lambda s: all(s.usable) and not s.notes)
            event.clear()
            alone = until(lambda s: bool(s.notes) and told in s.notes[0])  # noqa: B023
            assert alone.usable == (True, False)
            event.set()
        assert until(lambda s: all(s.usable) and not s.notes)
    finally:
        source.close()
    assert list(sets) == []


def test_loss_of_all_cameras_is_an_error(devices: list[Device], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_source, "SOURCES", replace(SOURCES, all_lost_s=0.3))
    source = CameraSource([0, 1])
    sets = iter(source)
    next(sets)
    for device in devices:
        device.plugged.clear()
    with pytest.raises(CaptureError, match="no camera gives images any more"):
        list(sets)
    source.close()


def test_samples_are_complete_image_sets(devices: list[Device]) -> None:
    source = CameraSource([0, 1])
    timer = threading.Timer(0.15, devices[1].plugged.clear)
    timer.start()
    threading.Timer(0.6, devices[1].plugged.set).start()
    samples = list(source.samples(60))
    source.close()
    assert len(samples) == 60
    assert min(image.max() for images in samples for image in images) == 220
