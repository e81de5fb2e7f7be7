"""No text of a panel is cut off in a sidebar of the default width."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from heroes import save_hero
from measured_layout import CONTENT_PX, ICON_PX, Context, Layout, Problem, cut_off, stand_in, text_px

FILES = Path(__file__).parents[2] / "compatibility" / "files"
HEADER_PX = CONTENT_PX - 2 * ICON_PX  # between the arrow and what panels are dragged by


@pytest.fixture
def panels(part: Callable[[str], Any]) -> list[type]:
    """All panels of the sidebar."""
    return [panel for panel in part("preferences.sidebar_tab")._registered if hasattr(panel, "bl_label")]


def problems(panels: list[type]) -> dict[str, list[Problem]]:
    """Return what is cut off, by panel."""
    found = {}
    for panel in panels:
        if hasattr(panel, "poll") and not panel.poll(Context()):
            continue
        texts = cut_off(lambda drawn, context: drawn.draw(context), panel)
        if hasattr(panel, "draw_header_preset"):
            row = Layout("row")
            row.label(text=panel.bl_label)
            stand_in(panel, row).draw_header_preset(Context())
            texts += row.problems(HEADER_PX)
        if texts:
            found[panel.__name__] = texts
    return found


@pytest.mark.parametrize("source", ["SIMULATED", "CAMERAS", "VIDEOS", "IMAGES", "VMC"])
@pytest.mark.parametrize("more", [False, True])
def test_panels_of_each_source(panels: list[type], chosen: Any, source: str, more: bool) -> None:
    chosen.source, chosen.practise, chosen.board_timed = source, more, more
    chosen.follow = "PERSON" if more else "MARKERS"
    chosen.threshold_auto, chosen.board_kind = not more, "CHARUCO" if more else "CHESSBOARD"
    chosen.left_video = chosen.calibration = "/no/such/place/of/a/file-with-a-long-name.toml" if more else ""
    assert len(panels) > 12
    assert problems(panels) == {}


def test_each_step_of_the_guide(part: Any, panels: list[type], chosen: Any, monkeypatch: Any) -> None:
    steps = part("settings.guide_steps")
    (guide,) = [panel for panel in panels if panel.__name__ == "PERFANIM_PT_guide"]
    for source in ("SIMULATED", "CAMERAS", "VIDEOS", "IMAGES"):
        chosen.source, chosen.practise = source, True
        for number, step in enumerate(steps.STEPS):
            state = step.state(chosen)
            monkeypatch.setattr(steps, "next_step", lambda _, now=(number, step, state): now)
            assert problems([guide]) == {}, f"{source}: {step.title}"


def test_characters_targets_sketches_and_takes(part: Any, panels: list[type], tmp_path: Any) -> None:
    save_hero(tmp_path / "hero.blend")
    chosen = bpy.context.scene.perfanim
    chosen.armature = bpy.data.objects["Hero"]
    assert chosen.armature.perfanim_character.joints
    bpy.context.view_layer.objects.active = chosen.armature
    assert bpy.ops.perfanim.add_controls() == {"FINISHED"}
    for kind in ("PROP", "PERFORMER"):
        assert bpy.ops.perfanim.add_target() == {"FINISHED"}
        bpy.context.scene.perfanim_targets.entries[-1].kind = kind
        assert problems(panels) == {}
    bpy.context.scene.perfanim_batch.character = str(tmp_path / "hero.blend")
    assert problems(panels) == {}
    whole = (FILES / "written-live.perftake").read_bytes()
    for name, data in (("A walk of a whole afternoon", whole), ("half", whole[: len(whole) // 2])):
        (part("take_library").folder() / f"{name}.perftake").write_bytes(data)
    part("take_library").forget()
    part("panels.takes_panel")._fill()
    shown = bpy.context.window_manager.perfanim_takes
    assert len(shown.entries) == 2
    for shown.active in range(2):
        assert problems(panels) == {}


def test_a_running_capture(part: Any, panels: list[type]) -> None:
    (panel,) = [panel for panel in panels if panel.__name__ == "PERFANIM_PT_capture"]
    module = part("panels.capture_panel")
    figures = module.Statistics()
    for name, value in {"received": 123456, "lost": 12345, "blind": 12345, "waiting": 120, "not_shown": 12345}.items():
        assert hasattr(figures, name)
        object.__setattr__(figures, name, value)
    pose = SimpleNamespace(performers=[SimpleNamespace(confidence=0.5)] * 2)
    notice = "camera 1 gives nothing for 0.3 s"
    run = SimpleNamespace(statistics=figures, notices=[notice], fraction=0.5, activity="", poses=[pose])
    setup = SimpleNamespace(performers=[SimpleNamespace(name=name) for name in ("Anna", "Ben")])
    capture = SimpleNamespace(run=run, setup=setup, job=None, line="")
    assert part("capture.live_capture").further_performers(capture) == [("Ben", 0.5)]
    texts = cut_off(lambda drawn, context: drawn._draw_statistics(context, drawn.layout, capture), panel)
    assert texts == []


def test_what_a_job_asks_for_stands_whole(part: Any, monkeypatch: Any) -> None:
    jobs, drawing = part("jobs.job"), part("panels.panel_drawing")
    words = "1: arms straight down, palms to the thighs, hands half forward"
    for text, is_whole in ((words, False), ("hold still", True)):
        job = jobs.Job("Calibrating", "subject", jobs.command(()), None, first=SimpleNamespace())
        job.text, job.fraction = text, 0.25
        monkeypatch.setattr(drawing.activity, "current", lambda running=job: running)
        layout = Layout("column")
        drawing.draw_job(Context(), layout, "subject")
        row, *below = layout.children
        assert row.children[0].facts["text"] == (text if is_whole else "25%")
        lines = [line.facts["text"] for column in below for line in column.children]
        assert " ".join(lines) == ("" if is_whole else text)
        assert list(layout.problems(CONTENT_PX)) == []


def test_a_text_that_is_too_long_is_found(panels: list[type]) -> None:
    def draw(drawn: Any, _context: Any) -> None:
        drawn.layout.label(text="m" * 60)
        drawn.layout.operator("perfanim.start_capture", text="Short")
        row = drawn.layout.row()
        for _ in range(3):
            row.operator("perfanim.start_capture", text="Fairly Long Words")

    found = cut_off(draw, panels[0])
    assert [text[:1] for text, *_ in found] == ["m", "F"]
    assert text_px("mm") > text_px("ii")
