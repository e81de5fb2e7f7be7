import math

import cv2
import numpy as np
import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.vision.sources import camera_source
from perfanim.core.vision.sources.camera_controls import apply_controls
from perfanim.core.vision.sources.camera_source import CameraSource
from perfanim.core.vision.sources.source_requests import CameraControls
from perfanim.core.worker.open_source import open_source


class Driver:
    """A camera of one backend that takes some properties, in steps."""

    def __init__(self, backend: str, takes: dict[int, float]) -> None:
        self.backend, self.takes, self.told = backend, takes, []
        self.values: dict[int, float] = {}

    def getBackendName(self) -> str:  # noqa: N802 - OpenCV's name
        return self.backend

    def set(self, what: int, value: float) -> bool:
        self.told.append((what, value))
        if what not in self.takes:
            return False
        self.values[what] = round(value / self.takes[what]) * self.takes[what]
        return True

    def get(self, what: int) -> float:
        return self.values.get(what, -1.0)

    def release(self) -> None:
        pass

    def grab(self) -> bool:
        return False


EVERYTHING = {cv2.CAP_PROP_EXPOSURE: 1.0, cv2.CAP_PROP_GAIN: 1.0, cv2.CAP_PROP_FOCUS: 1.0}


@pytest.mark.parametrize(
    ("backend", "manual", "exposure"), [("V4L2", 1.0, 20.0), ("DSHOW", 0.0, -9.0), ("MSMF", 0.0, -9.0)]
)
def test_controls_are_set_in_the_drivers_units_after_automatic_is_off(backend, manual, exposure):
    driver = Driver(backend, EVERYTHING)
    assert apply_controls(driver, CameraControls(exposure_s=0.002, gain=4.0, focus=30.0)) == []
    assert driver.values[cv2.CAP_PROP_EXPOSURE] == exposure
    assert 0.002 / 1.5 < (exposure / 1e4 if backend == "V4L2" else 2.0**exposure) < 0.002 * 1.5
    order = [what for what, _ in driver.told]
    off = max(i for i, told in enumerate(driver.told) if told == (cv2.CAP_PROP_AUTO_EXPOSURE, manual))
    assert off < order.index(cv2.CAP_PROP_EXPOSURE)
    assert driver.values[cv2.CAP_PROP_GAIN] == 4.0 and driver.values[cv2.CAP_PROP_FOCUS] == 30.0
    assert (cv2.CAP_PROP_AUTOFOCUS, 0.0) in driver.told


@pytest.mark.parametrize(("backend", "automatic"), [("V4L2", 3.0), ("DSHOW", 1.0)])
def test_unset_controls_become_automatic(backend, automatic):
    driver = Driver(backend, EVERYTHING)
    assert apply_controls(driver, CameraControls()) == []
    assert driver.told == [(cv2.CAP_PROP_AUTO_EXPOSURE, automatic), (cv2.CAP_PROP_AUTOFOCUS, 1.0)]


def test_refused_controls_are_reported(monkeypatch):
    picture = np.zeros((48, 64, 3), np.uint8)
    coarse = {cv2.CAP_PROP_EXPOSURE: 100.0, cv2.CAP_PROP_GAIN: 1.0}  # tenths of a millisecond: 2 ms become 0
    drivers = [Driver("V4L2", coarse), Driver("V4L2", EVERYTHING)]
    monkeypatch.setattr(camera_source, "_open", lambda device, *_: (drivers[device], picture))
    told = CameraControls(exposure_s=0.002, gain=10.0, focus=5.0)
    source = CameraSource([0, 1], controls=[told, told])
    source.close()
    (warning,) = source.warnings
    assert warning.startswith("camera 0 does not accept exposure and focus")


def test_controls_come_from_the_description(monkeypatch):
    drivers = [Driver("V4L2", EVERYTHING), Driver("V4L2", EVERYTHING)]
    monkeypatch.setattr(camera_source, "_open", lambda device, *_: (drivers[device], np.zeros((48, 64, 3), np.uint8)))
    open_source({"kind": "cameras", "devices": [0, 1], "controls": [{"exposure_s": 0.004, "gain": None}]}).close()
    assert drivers[0].values == {cv2.CAP_PROP_EXPOSURE: 40.0}
    assert drivers[1].told == []


@pytest.mark.parametrize("spec", [{"exposure_s": 0.0}, {"exposure_s": 30}, {"exposure_s": "long"}])
def test_impossible_controls_are_refused(spec):
    with pytest.raises(SettingsError, match="exposure_s must be a number above 0 s up to 1 s"):
        open_source({"kind": "cameras", "devices": [0, 1], "controls": [spec]})


def test_nan_exposure_is_refused():
    with pytest.raises(SettingsError):
        CameraControls(exposure_s=math.nan)
