"""Exposure, gain and focus of cameras.

Drivers disagree about units and about how automatic controls are switched off, so values are read back. Exposure is in
tenths of a millisecond on Linux (V4L2) and the base-2 logarithm of seconds elsewhere; gain and focus are in the
camera's own units.
"""

import math
from collections.abc import Sequence
from typing import Any

import cv2

from .source_requests import CameraControls
from .source_settings import SOURCES

_V4L2 = "V4L2"
_MANUAL, _AUTOMATIC = {_V4L2: 1.0}, {_V4L2: 3.0}


def apply_controls(capture: Any, controls: CameraControls) -> Sequence[str]:
    """Set controls of an open `cv2.VideoCapture`; return the names of those that the camera refused.

    Controls without a value are switched back to automatic, because cameras remember the last program's settings.
    """
    backend = str(capture.getBackendName())
    refused = []
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _AUTOMATIC.get(backend, 1.0))
    if controls.exposure_s is not None:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL.get(backend, 0.0))
        if not _set_exposure(capture, backend, controls.exposure_s):
            refused.append("exposure")
    if controls.gain is not None and not _set(capture, cv2.CAP_PROP_GAIN, controls.gain):
        refused.append("gain")
    capture.set(cv2.CAP_PROP_AUTOFOCUS, float(controls.focus is None))
    if controls.focus is not None and not _set(capture, cv2.CAP_PROP_FOCUS, controls.focus):
        refused.append("focus")
    return refused


def _set_exposure(capture: Any, backend: str, seconds: float) -> bool:
    value = seconds * 10_000.0 if backend == _V4L2 else math.log2(seconds)
    if not capture.set(cv2.CAP_PROP_EXPOSURE, value):
        return False
    taken = float(capture.get(cv2.CAP_PROP_EXPOSURE))
    away = abs(math.log2(taken / value)) if backend == _V4L2 and taken > 0.0 else abs(taken - value)
    return away <= math.log2(SOURCES.exposure_step)


def _set(capture: Any, what: int, value: float) -> bool:
    return bool(capture.set(what, value)) and abs(float(capture.get(what)) - value) <= SOURCES.control_step
