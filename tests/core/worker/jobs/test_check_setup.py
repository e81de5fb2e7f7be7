"""The check before a capture: simulated cameras by the real worker, with and without a calibration, and its faults."""

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from jobs_played import outcome, played, said
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.simulate import practice_studio
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.subjects.setup_check.finding import Fault
from perfanim.core.vision.common_space import common_space
from perfanim.core.worker.jobs import check_setup
from perfanim.core.worker.protocol import MessageKind
from perfanim.core.worker.requests import read_request

SOURCE = {"kind": "simulated", "behaviour": "walking", "height_m": 1.75, "marker_set": "boxing", "loop": True}


def asked(**more: Any) -> dict[str, Any]:
    return {"job": "check setup", "source": SOURCE, "marker_set": "boxing", "rig": None, **more}


@pytest.fixture(scope="module")
def checked_here() -> Iterator[Callable[..., tuple[dict[str, Any], np.ndarray]]]:
    """checked_here(...) -> the result and the last picture of a check in this process, of half as many pictures."""

    def check(**more: Any) -> tuple[dict[str, Any], np.ndarray]:
        pictures: list[np.ndarray] = []
        results: list[dict[str, Any]] = []
        channel: Any = SimpleNamespace(
            stop_requested=threading.Event(),
            send_status=lambda *_: None,
            send_preview=pictures.append,
            send_result=results.append,
        )
        check_setup.run(read_request("check setup", asked(**more)), channel)
        return results[0], pictures[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(practice_studio, "FPS", 15.0)
        patch.setattr(check_setup, "FPS", 15.0)
        yield check


def test_a_healthy_studio_without_a_calibration_has_no_fault_and_no_space(checked_here: Any) -> None:
    found, _ = checked_here()
    assert found == {"findings": [], "space": ""}


@pytest.mark.long
def test_a_healthy_studio_is_checked_with_a_calibration() -> None:
    rig = default_rig()
    rig.metadata["floor"] = "y = 0"
    messages = played(asked(rig=rig_tables(rig)))
    found = outcome(messages).json()
    assert any(text.startswith("hold still: stand upright, arms straight out") for text in said(messages))
    assert "walk about" in said(messages)
    assert found == {"findings": [], "space": common_space(rig).text}
    assert found["space"].startswith("you may walk ")
    *_, shown = (m.preview() for m in messages if m.kind is MessageKind.PREVIEW)
    for picture in np.array_split(shown, 2, axis=1):  # the space lies on the floor, in both pictures
        outlined = np.abs(picture.astype(int) - (80, 255, 80)).max(axis=2) < 40
        assert outlined.sum() > 50
        assert outlined[: len(picture) // 3].sum() == 0


@pytest.mark.parametrize(
    "fault", [Fault.DARK, *(pytest.param(each, marks=pytest.mark.long) for each in (Fault.BUMPED, Fault.REFLECTION))]
)
def test_a_fault_to_practise_on_is_named(fault: Fault, checked_here: Any) -> None:
    found, shown = checked_here(fault=str(fault))
    assert {row["fault"] for row in found["findings"]} == {str(fault)}
    ringed = int((abs(shown.astype(int) - (255, 170, 60)).max(axis=2) < 30).sum())
    assert (ringed > 20) == (fault is Fault.REFLECTION)


@pytest.mark.long
def test_reflections_that_are_ignored_are_no_fault_and_are_crossed_out(checked_here: Any) -> None:
    practised, _ = checked_here(fault=str(Fault.REFLECTION))
    places = [place for row in practised["findings"] for place in row["places"]]
    assert places
    found, shown = checked_here(fault=str(Fault.REFLECTION), rig=rig_tables(default_rig()), ignored=places)
    assert found["findings"] == []
    for camera, x, y in places:  # the pictures are half as large
        x, y = round(x / 2 + 320 * camera), round(y / 2)
        near = shown[y - 4 : y + 5, x - 4 : x + 5].astype(int)
        assert (abs(near - 200).max(axis=2) < 40).sum() >= 5


def test_a_stop_ends_the_check_without_a_result() -> None:
    messages = played(asked(), lambda m: m.kind is MessageKind.PREVIEW)
    assert not [m for m in messages if m.kind in (MessageKind.RESULT, MessageKind.ERROR)]
