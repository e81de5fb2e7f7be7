"""The empty panels that make Blender align the others when these grow."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest


class Sidebar:
    """A region and the empty panels that it shows each time when it is drawn."""

    def __init__(self, panels: Any, pointer: int) -> None:
        self._panels = panels.PERFANIM_PT_alignment, panels.PERFANIM_PT_alignment_next
        self._context = SimpleNamespace(region=SimpleNamespace(as_pointer=lambda: pointer))

    def draw(self) -> str:
        return "".join(panel.__name__ for panel in self._panels if panel.poll(self._context))


@pytest.fixture
def panels(part: Callable[[str], Any]) -> Any:
    return part("panels.alignment")


@pytest.fixture
def activity(part: Callable[[str], Any]) -> Any:
    return part("jobs.activity")


def test_one_is_always_there_and_stays_while_nothing_grows(panels: Any) -> None:
    sidebar = Sidebar(panels, 1)
    assert sidebar.draw() == sidebar.draw() == sidebar.draw() != ""


def test_the_other_one_comes_in_every_sidebar_when_a_message_comes(panels: Any, activity: Any) -> None:
    sidebars = Sidebar(panels, 1), Sidebar(panels, 2)
    before = [sidebar.draw() for sidebar in sidebars]
    activity.set_message("capture", "stopped")
    after = [sidebar.draw() for sidebar in sidebars]
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert [sidebar.draw() for sidebar in sidebars] == after


def test_a_notice_of_a_running_capture_is_seen(
    panels: Any, activity: Any, part: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = part("capture.live_capture").LiveCapture(None)
    monkeypatch.setattr(activity, "current", lambda: capture)
    sidebar = Sidebar(panels, 1)
    starting = sidebar.draw()
    capture.run = SimpleNamespace(statistics=SimpleNamespace(waiting=0), notices=[], poses=[])
    running = sidebar.draw()
    capture.run.notices = ["no images for 0.3 s"]
    warned = sidebar.draw()
    capture.run.statistics.waiting = 5
    behind = sidebar.draw()
    assert starting != running != warned != behind
    refinement = part("settings.performer_refinement")
    refinement.offer.refined = refinement.Refined("walk.perftake", None, ("arms 4 % shorter (± 1 %)",))
    assert sidebar.draw() != behind
