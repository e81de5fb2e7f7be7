"""A capture that is driven as Blender's timer drives it."""

import time
from typing import Any

import bpy

PATIENCE_S = 600.0


def tick_until(capture: Any, condition: Any) -> None:
    limit = time.monotonic() + PATIENCE_S
    while not condition():
        assert not capture.done, capture.run.error
        assert time.monotonic() < limit, capture.line
        capture.tick(bpy.context)
        time.sleep(1 / 60)
