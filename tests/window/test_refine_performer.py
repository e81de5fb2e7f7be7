"""The Takes panel: a take's performer whose bones are too long is refined, looked at and used."""

from pathlib import Path

import numpy as np
import pytest
from desktop import BlenderWindow, Desktop
from perfanim.core.markers.subject import load_subject
from pointing import Hand
from sidebar_steps import said_of_takes
from wrong_performer import record_walk_of_a_wrong_performer


def test_a_performer_is_refined_by_a_take_and_used(desktop: Desktop, window: BlenderWindow, tmp_path: Path) -> None:
    made = record_walk_of_a_wrong_performer(tmp_path)
    values = {"subject": str(tmp_path / "anna.toml"), "database": str(tmp_path / "walk.pfdb")}
    window.order("set", values={**values, "marker_set": "locomotion"})
    window.open_tab("Perfanim")
    files = [{"name": "walk.take.npz"}]
    window.order("call", operator="import_takes", arguments={"directory": str(tmp_path), "files": files})
    said_of_takes(window, "imported")
    hand = Hand(desktop, window, "refine")
    hand.toggle("Capture")
    hand.toggle("Takes")
    hand.shot("take")
    hand.click("Refine Performer", sidebar=True)
    window.wait(lambda s: s["capture"]["activity"], "start of the refinement")
    window.wait(lambda s: s["capture"]["activity"] is None, "end of the refinement")
    hand.scroll_to_the_end()
    hand.shot("changes")
    hand.click("Use", sidebar=True)
    assert "anna refined.toml is used from now on" in said_of_takes(window, "refined")
    hand.shot("used")
    found = load_subject(tmp_path / "anna refined.toml")
    lengths = [np.linalg.norm(each.skeleton.offsets_m[1:], axis=1).sum() for each in (made.right, made.wrong, found)]
    assert abs(lengths[2] - lengths[0]) < 0.6 * abs(lengths[1] - lengths[0])
    assert load_subject(tmp_path / "anna.toml").skeleton.offsets_m == pytest.approx(made.wrong.skeleton.offsets_m)
