"""A capture whose poses the test has made."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.markers.subject import Subject


class PlayedCapture:
    """Starts captures that get one of the given poses at each tick; `marked` has what was noted in the take."""

    def __init__(self, part: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.marked: list[tuple[Any, ...]] = []
        self._part, self._monkeypatch = part, monkeypatch
        monkeypatch.setattr(part("take_library"), "mark_captured", lambda *given: self.marked.append(given))

    def __call__(self, poses: Sequence[ScenePose], *performers: Subject) -> Any:
        run = SimpleNamespace(poses=[], persistent_warning="", activity="", take_preview=lambda: None)
        run.tick = lambda: run.poses.append(poses[len(run.poses)]) or run.poses[-1]
        run.shown = run.close = run.stop = lambda: None
        request = SimpleNamespace(take="a.perftake")
        setup = SimpleNamespace(performers=performers, props=(), request=request, start=lambda _: run)
        self._monkeypatch.setattr(self._part("capture.capture_request"), "make", lambda _: setup)
        bpy.context.scene.perfanim.overlay = set()  # there are no cameras
        return self._part("capture.live_capture").LiveCapture(None)


@pytest.fixture
def play(part: Any, monkeypatch: pytest.MonkeyPatch) -> PlayedCapture:
    """Start a capture of made-up poses."""
    return PlayedCapture(part, monkeypatch)


@pytest.fixture
def skeleton(part: Any, chosen: Any) -> Any:
    """The skeleton of the settings' performer."""
    return part("operators.character_operators").performer_skeleton(chosen)


@pytest.fixture
def armature(part: Any, skeleton: Any) -> Any:
    """A new character for the performer."""
    return bpy.data.objects[part("capture.performer_targets").add_character(bpy.context, skeleton)]
