"""Reflections that cannot be covered: ignored places in the cameras' pictures.

They stand in the calibration; those of cameras that are not calibrated yet wait in the scene for one.
"""

import json
from collections import Counter
from collections.abc import Sequence
from typing import Any

from ...core.geometry.camera import CameraRig
from ...core.geometry.rig_file import save_ignored
from ...core.vision.sources.image_set import camera_title
from ..preferences.paths import absolute
from . import readiness

Place = tuple[int, float, float]  # index of the camera, pixel
_MOST_CAMERAS, _MOST_PX = 64, 100_000


def ignored(settings: Any) -> list[Place]:
    """Return the ignored places of the chosen cameras."""
    rig = _rig(settings)
    if rig is None:
        return _waiting(settings).get(settings.source, [])
    return [(int(camera), float(x), float(y)) for camera, x, y in rig.ignored]


def keep(settings: Any, places: Sequence[Place]) -> None:
    """Ignore these places alone.

    Raises:
        PerfanimError: they cannot be written into the calibration.
    """
    if _rig(settings) is not None:
        save_ignored(absolute(settings.calibration), places)
    else:
        settings.ignored_places = json.dumps({**_waiting(settings), settings.source: list(places)})


def sentences(settings: Any) -> list[tuple[int, str]]:
    """Return the index of each camera with ignored places, and how many these are."""
    rig = _rig(settings)
    counts = Counter(camera for camera, *_ in ignored(settings))
    names = [str(index + 1) for index in range(len(rig) if rig else max([2, *(camera + 1 for camera in counts)]))]
    return [
        (camera, f"{'1 place is' if count == 1 else f'{count} places are'} ignored in {camera_title(camera, names)}")
        for camera, count in sorted(counts.items())
    ]


def _rig(settings: Any) -> CameraRig | None:
    rig = readiness.rig(absolute(settings.calibration)) if settings.calibration else None
    return rig if isinstance(rig, CameraRig) else None


def _waiting(settings: Any) -> dict[str, list[Place]]:
    """Return the places of cameras without a calibration, by source.

    They are text in a .blend that somebody else may have written: anything but such a table counts as none.
    """
    try:
        table = json.loads(settings.ignored_places or "{}")
        return {
            source: [(int(camera), float(x), float(y)) for camera, x, y in rows if _may_be(camera, x, y)]
            for source, rows in table.items()
        }
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return {}


def _may_be(camera: float, x: float, y: float) -> bool:
    return 0 <= camera < _MOST_CAMERAS and abs(x) < _MOST_PX and abs(y) < _MOST_PX
