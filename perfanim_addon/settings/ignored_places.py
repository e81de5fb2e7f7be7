"""Ignored positions in the cameras' pictures, for reflections that cannot be covered.

They are stored in the calibration, or in the scene until there is a calibration.
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


def ignored(settings: Any) -> list[Place]:
    """Return the ignored positions of the chosen cameras."""
    rig = _rig(settings)
    if rig is None:
        return _waiting(settings).get(settings.source, [])
    return [(int(camera), float(x), float(y)) for camera, x, y in rig.ignored]


def keep(settings: Any, places: Sequence[Place]) -> None:
    """Ignore only these positions; PerfanimError if the calibration cannot be written."""
    if _rig(settings) is not None:
        save_ignored(absolute(settings.calibration), places)
    else:
        settings.ignored_places = json.dumps({**_waiting(settings), settings.source: list(places)})


def sentences(settings: Any) -> list[tuple[int, str]]:
    """Return the index of each camera with ignored positions, and a sentence with their number."""
    rig = _rig(settings)
    counts = Counter(camera for camera, *_ in ignored(settings))
    names = [str(index + 1) for index in range(len(rig) if rig else max([2, *(camera + 1 for camera in counts)]))]
    return [
        (camera, f"{'1 place is' if count == 1 else f'{count} places are'} ignored in {camera_title(camera, names)}")
        for camera, count in sorted(counts.items())
    ]


def _rig(settings: Any) -> CameraRig | None:
    return readiness.found(readiness.rig, absolute(settings.calibration)) if settings.calibration else None


def _waiting(settings: Any) -> dict[str, list[Place]]:
    """Return the positions for cameras without a calibration, by source.

    The text may come from someone else's .blend: invalid content and unlikely positions are left out.
    """
    try:
        table = json.loads(settings.ignored_places or "{}")
        return {
            source: [
                (int(camera), float(x), float(y))
                for camera, x, y in rows
                if 0 <= camera < 64 and abs(x) < 100_000 and abs(y) < 100_000
            ]
            for source, rows in table.items()
        }
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return {}
