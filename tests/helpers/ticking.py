"""What Blender's timer does, without a window."""

import time
from collections.abc import Callable
from typing import Any

import bpy

PATIENCE_S = 600.0


def repeat(
    step: Callable[[], Any], until: Callable[[], Any], told: Callable[[], str] = str, pause_s: float = 0.02
) -> None:
    """Repeat a step until a condition holds; after too long, fail with what `told` returns."""
    limit = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < limit, told()
        step()
        time.sleep(pause_s)


def tick(capture: Any, count: int) -> None:
    """Tick a capture so many times."""
    for _ in range(count):
        capture.tick(bpy.context)


def tick_until(capture: Any, condition: Callable[[], Any]) -> None:
    """Tick a capture until a condition holds; it must not end before."""

    def step() -> None:
        assert not capture.done, capture.run.error
        capture.tick(bpy.context)

    repeat(step, condition, lambda: capture.line, 1 / 60)


def tick_poses(capture: Any, count: int) -> None:
    """Tick a capture until it has so many poses."""
    tick_until(capture, lambda: capture.run is not None and len(capture.run.poses) >= count)


def stop_and_keep(capture: Any) -> str:
    """Stop a capture, write its recordings, and return the report."""
    capture.stop()
    tick_until(capture, lambda: capture.done)
    return str(capture.keep(bpy.context))
