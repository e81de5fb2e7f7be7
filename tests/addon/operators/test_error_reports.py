"""Where an error is shown: once, where the user looks."""

from types import SimpleNamespace
from typing import Any

import bpy


def shown(part: Any, error: Exception, region: str) -> tuple[set[str], str]:
    """Return kind and text of what an operator reports that was clicked on in such a region of the 3D view."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    there = next(found for found in area.regions if found.type == region)
    reports: list[tuple[set[str], str]] = []
    operator = SimpleNamespace(report=lambda kind, text: reports.append((kind, text)))
    with bpy.context.temp_override(window=window, area=area, region=there):
        assert part("operators.operator_bases").report_error(operator, "takes", error) == {"CANCELLED"}
    (report,) = reports
    return report


def test_an_error_pops_up_whole_unless_it_was_clicked_for_in_the_sidebar(part: Any, errors: Any) -> None:
    error = errors.TakeError("a thing of which there is much to say " * 4, where="walk.c3d", advice="say less")
    kind, text = shown(part, error, "WINDOW")
    assert kind == {"ERROR"} and max(map(len, text.splitlines())) <= 81
    assert " ".join(text.split()) == " ".join(str(error).split())
    assert shown(part, error, "UI")[0] == {"WARNING"}  # no pop-up: the panel beside the pointer says it
    assert part("jobs.activity").message("takes") == (str(error), "ERROR")
