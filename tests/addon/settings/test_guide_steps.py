"""The guide shows one next step at a time, judged by the settings and by the last check of the pictures."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from measured_layout import Layout
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry.rig_file import load_rig, rig_tables, save_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.common_space import common_space

GOOD: dict[str, Any] = {"findings": [], "space": ""}
DARK = {"findings": [{"fault": "too dark", "text": "the left camera is too dark: expose longer"}], "space": ""}
FAR = {"findings": [{"fault": "too far", "text": "you are too far away: use larger images"}], "space": ""}
BUMPED = {"findings": [{"fault": "camera bumped", "text": "a camera was moved: calibrate again"}], "space": ""}


@pytest.fixture
def guide(part: Any) -> Any:
    return part("settings.guide_steps")


def title(guide: Any, chosen: Any) -> str:
    return str(guide.next_step(chosen)[1].title)


def calibrate(chosen: Any, path: Path, floor: bool) -> None:
    rig = default_rig()
    if floor:
        rig.metadata["floor"] = "y = 0"
    save_rig(rig, path)
    chosen.calibration = str(path)


def test_each_step_follows_the_one_that_is_done(guide: Any, chosen: Any, tmp_path: Path) -> None:
    assert title(guide, chosen) == "Cameras"  # the simulated performer needs none of it
    chosen.practise = True
    assert title(guide, chosen) == "Exposure"
    guide.keep_check(chosen, DARK)
    assert guide.next_step(chosen)[2].problem == "the left camera is too dark: expose longer"
    guide.keep_check(chosen, FAR)
    assert guide.next_step(chosen)[2].problem == "you are too far away: use larger images"
    guide.keep_check(chosen, GOOD)
    assert title(guide, chosen) == "Calibrate"
    calibrate(chosen, tmp_path / "cameras.toml", floor=False)
    assert title(guide, chosen) == "Floor"
    calibrate(chosen, tmp_path / "cameras-on-floor.toml", floor=True)
    assert title(guide, chosen) == "Markers"  # the last check was made without this calibration
    guide.keep_check(chosen, BUMPED)
    assert "a camera was moved" in guide.next_step(chosen)[2].problem
    guide.keep_check(chosen, {**GOOD, "space": "you may walk 2.1 x 1.6 m"})
    assert guide.space(chosen) == "you may walk 2.1 x 1.6 m"
    assert title(guide, chosen) == "Performer"
    save_subject(Subject("Anna", default_skeleton(), load_marker_set("boxing"), 0.006), tmp_path / "anna.toml")
    chosen.subject = str(tmp_path / "anna.toml")
    assert title(guide, chosen) == "Capture"
    chosen.database = str(tmp_path / "none.pfdb")
    assert title(guide, chosen) == "Database"
    assert "none.pfdb" in guide.next_step(chosen)[2].problem
    chosen.database = ""
    chosen.armature = bpy.data.objects.new("Bare", bpy.data.armatures.new("Bare"))
    assert title(guide, chosen) == "Character"


def test_a_check_holds_for_its_pictures_only(part: Any, guide: Any, chosen: Any, monkeypatch: Any) -> None:
    chosen.source = "CAMERAS"
    assert title(guide, chosen) == "Cameras"  # nobody has looked yet which number is which
    monkeypatch.setattr(part("settings.camera_choice"), "device_numbers", lambda: [0])
    assert not bpy.ops.perfanim.skip_step.poll()  # the right camera is not plugged in
    monkeypatch.setattr(part("settings.camera_choice"), "device_numbers", lambda: [0, 1, 2])
    bpy.ops.perfanim.skip_step()
    assert title(guide, chosen) == "Exposure"
    guide.keep_check(chosen, GOOD)
    assert title(guide, chosen) == "Calibrate"
    chosen.right_device = 2
    assert title(guide, chosen) == "Cameras"
    chosen.left_device = 2
    assert "chosen twice" in guide.next_step(chosen)[2].problem
    assert not bpy.ops.perfanim.skip_step.poll()


def test_optional_steps_can_be_skipped_and_no_others(guide: Any, chosen: Any, tmp_path: Path) -> None:
    skip = bpy.ops.perfanim.skip_step
    assert not skip.poll()
    chosen.practise = True
    skip()
    assert title(guide, chosen) == "Calibrate"
    assert not skip.poll()
    calibrate(chosen, tmp_path / "cameras.toml", floor=False)
    skip()
    skip()
    assert title(guide, chosen) == "Performer"
    names = [step.title for step in guide.steps(chosen) if guide.is_skipped(chosen, step)]
    assert names == ["Exposure", "Floor", "Markers"]
    assert bpy.ops.perfanim.unskip_steps() == {"FINISHED"}
    assert title(guide, chosen) == "Exposure"
    assert not bpy.ops.perfanim.unskip_steps.poll()
    for _ in names:
        skip()
    chosen.practise_fault = "DARK"  # other pictures
    assert title(guide, chosen) == "Exposure"


def test_a_calibration_to_be_done_again_is_no_step_done(guide: Any, chosen: Any, tmp_path: Path) -> None:
    chosen.practise = True
    guide.keep_check(chosen, GOOD)
    rig = default_rig()
    rig.metadata["verdict"] = "redo"
    save_rig(rig, tmp_path / "short-walk.toml")
    chosen.calibration = str(tmp_path / "short-walk.toml")
    step = guide.next_step(chosen)[1]
    assert step.title == "Calibrate" and step.passing(chosen) == "Use This Calibration"
    bpy.ops.perfanim.skip_step()
    assert title(guide, chosen) == "Floor"
    state = guide.readiness.cameras(chosen)
    assert state.ready and state.text == "calibrate again" and "verdict is redo" in state.doubt
    chosen.practise = False  # the simulated performer needs no calibration
    assert guide._calibrated(chosen).ready


def test_trackers_need_no_camera_steps(guide: Any, chosen: Any) -> None:
    chosen.source = "VMC"
    state = guide.readiness.pictures(chosen)
    assert title(guide, chosen) == ("Performer" if state.ready else "Cameras")


def test_each_sentence_is_about_its_button(guide: Any, chosen: Any) -> None:
    steps = {step.title: step for step in guide.STEPS}
    sentences = {
        "CAMERAS": (
            "stand in front of",
            "Hold the board",
            "Lay the board",
            "Put on the markers",
            "Leave the view",
            "Walk about",
        ),
        "IMAGES": (
            "the recording",
            "Choose the folders",
            "Skip this step",
            "that was worn",
            "the three poses",
            "at the end",
        ),
        "VMC": ("", "Choose the folders", "", "", "Type your height", "Walk about"),
    }
    for source, expected in sentences.items():
        chosen.source = source
        if source == "IMAGES":
            chosen.left_folder = chosen.right_folder = "/film"
        for name, words in zip(
            ("Exposure", "Calibrate", "Floor", "Markers", "Performer", "Capture"), expected, strict=True
        ):
            assert words in steps[name].text(chosen)


def test_every_button_is_an_operator_and_every_setting_exists(guide: Any, chosen: Any) -> None:
    for source in ("SIMULATED", "CAMERAS", "VIDEOS", "VMC"):
        chosen.source = source
        for step in guide.STEPS:
            name = step.operator(chosen)
            assert not name or bpy.ops.perfanim.__getattr__(name).get_rna_type().name
            for setting in step.drawn:
                assert hasattr(chosen, setting)


@pytest.mark.long
def test_a_fault_to_practise_on_is_found_by_the_button(part: Any, guide: Any, chosen: Any) -> None:
    operator = part("operators.guide_operators").PERFANIM_OT_check_setup
    assert not bpy.ops.perfanim.check_setup.poll()  # nothing is to be checked of known cameras
    chosen.practise, chosen.practise_fault = True, "BRIGHT"
    clicked = SimpleNamespace(keep_picture=lambda line: None)
    assert run_job(part, operator, clicked) == "fix first: too bright"
    assert "too bright" in guide.next_step(chosen)[2].problem
    chosen.practise_fault = "NONE"
    assert not operator.request(clicked, bpy.context).fault
    assert operator.on_result(clicked, bpy.context, GOOD) == "no fault was found"
    assert title(guide, chosen) == "Calibrate"


def test_the_space_of_a_good_check_is_drawn_until_the_next_job(
    part: Any, guide: Any, chosen: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overlay, activity = part("viewport.overlay"), part("jobs.activity")
    chosen.source = "CAMERAS"
    calibrate(chosen, tmp_path / "cameras.toml", floor=True)
    space = common_space(default_rig())
    clicked = SimpleNamespace(keep_picture=lambda line: None)
    check = part("operators.guide_operators").PERFANIM_OT_check_setup
    for summary in (BUMPED | {"space": space.text}, GOOD):
        check.on_result(clicked, bpy.context, summary)
        assert not overlay.handler.added
    assert check.on_result(clicked, bpy.context, GOOD | {"space": space.text}).endswith(space.text)
    drawn = overlay._state
    shapes, names = overlay.shapes_of(drawn.scene, drawn.pose, drawn.parts, lambda points_m: points_m[:, :2], 1.0)
    assert [text for text, _ in names] == [space.text]
    assert all(np.isfinite(corners).all() for corners in shapes.corners) and shapes.corners
    assert np.abs(drawn.scene.placed(space.outline_m)[:, 2]).max() == 0.0  # flat in Blender's axes
    activity.end()
    assert not overlay.handler.added


def test_reflections_are_ignored_and_looked_for_again_by_a_click(
    part: Any, guide: Any, chosen: Any, tmp_path: Path
) -> None:
    places = part("settings.ignored_places")
    check = part("operators.guide_operators").PERFANIM_OT_check_setup
    clicked = SimpleNamespace(keep_picture=lambda line: None)
    ignore, forget = bpy.ops.perfanim.ignore_reflections, bpy.ops.perfanim.forget_ignored
    chosen.practise, chosen.practise_fault = True, "REFLECTION"
    assert not ignore.poll() and not forget.poll()
    rows = [
        {"fault": "reflection", "text": "the cameras see 3", "places": ((0, 5.0, 6.0), (0, 7.0, 8.0), (1, 9.0, 9.0))}
    ]
    assert check.on_result(clicked, bpy.context, {"findings": rows, "space": ""}) == "fix first: reflection"
    found = guide.reflections(chosen)
    assert len(found) == 3
    assert ignore() == {"FINISHED"}
    assert title(guide, chosen) == "Calibrate" and not ignore.poll()
    assert places.ignored(chosen) == [tuple(place) for place in found.values()]
    assert [tuple(place) for place in check.request(clicked, bpy.context).ignored] == list(map(tuple, found.values()))
    assert check.on_result(clicked, bpy.context, GOOD) == "no fault was found"
    chosen.source = "CAMERAS"
    assert places.ignored(chosen) == []  # other cameras
    chosen.source = "SIMULATED"

    summary = {"rig": rig_tables(default_rig())}  # the calibration that follows takes them over
    part("operators.camera_operators")._use_rig(chosen, summary, "cameras.toml")
    assert len(load_rig(chosen.calibration).ignored) == len(found)
    first = places.sentences(chosen)[0]
    assert f"{sum(place[0] == first[0] for place in found.values())} place" in first[1]
    assert first[1].endswith(f"ignored in the {('left', 'right')[first[0]]} camera")
    assert part("capture.capture_request").calibration(chosen).cameras[first[0]].ignored_px.shape[1] == 2
    for camera, _ in places.sentences(chosen):
        assert forget(camera=camera) == {"FINISHED"}
    assert places.sentences(chosen) == []
    assert len(load_rig(chosen.calibration).ignored) == 0
    assert check.request(clicked, bpy.context).ignored == ()  # it is looked for as before


def test_each_reflection_is_ignored_by_its_number(part: Any, guide: Any, chosen: Any) -> None:
    preview, places = part("viewport.picture_overlay"), part("settings.ignored_places")
    chosen.source, chosen.practise = "SIMULATED", True
    rows = [
        {"fault": "reflection", "text": "the left camera sees 2", "places": ((0, 5.0, 6.0), (0, 7.0, 8.0))},
        {"fault": "too dark", "text": "dark", "places": ((0, 1.0, 1.0),)},
        {"fault": "reflection", "text": "the right camera sees 1", "places": ((1, 9.0, 9.0),)},
    ]
    guide.keep_check(chosen, {"findings": rows, "space": ""})
    preview.show(np.zeros((4, 8, 3), dtype=np.uint8), "reflection")

    def buttons() -> list[str]:
        drawn = Layout("column")
        part("panels.guide_panel")._draw_reflections(drawn, chosen)
        return list(filter(None, drawn.texts()))

    assert buttons() == ["Ignore These Places", "Only 1", "Only 2", "Only 3"]
    assert bpy.ops.perfanim.ignore_reflections(number=2) == {"FINISHED"}
    assert places.ignored(chosen) == [(0, 7.0, 8.0)]
    assert buttons() == ["Ignore These Places", "Only 1", "Only 3"]
    assert "the left camera sees 2" in guide.next_step(chosen)[2].problem
    assert preview.NAME in bpy.data.images  # its numbers still stand for the rest
    assert bpy.ops.perfanim.ignore_reflections() == {"FINISHED"}
    assert places.ignored(chosen) == [(0, 7.0, 8.0), (0, 5.0, 6.0), (1, 9.0, 9.0)]
    assert buttons() == []
    assert guide.next_step(chosen)[2].problem == "dark"
    assert preview.NAME not in bpy.data.images


@pytest.mark.parametrize(
    "text",
    [
        "[1]", "{", "7", '{"SIMULATED": 3}', '{"SIMULATED": [[0, 1]]}', '{"SIMULATED": [["a", 1, 2]]}',
        '{"SIMULATED": [[0, NaN, 2], [0, 2, NaN]]}', '{"SIMULATED": [[0, 1e999, 2]]}', '{"SIMULATED": [null]}',
        '{"SIMULATED": [[-1, 5, 2], [1e9, 5, 2]]}', "[" * 100_000,
    ],
)  # fmt: skip
def test_damaged_places_of_a_foreign_scene_are_none(part: Any, chosen: Any, text: str) -> None:
    places = part("settings.ignored_places")
    chosen.ignored_places = text
    assert places.ignored(chosen) == []
    assert places.sentences(chosen) == []


def test_the_last_capture_is_judged_until_all_is_forgotten(part: Any, guide: Any, chosen: Any) -> None:
    live = part("capture.live_capture")
    capture = live.LiveCapture(None)
    assert live.judge_capture(capture) == ""  # nothing was captured
    pose = SimpleNamespace(
        observed_m=np.zeros((2, 3)), single_cameras=np.full(2, -1), marker_rms_m=0.001, confidence=0.9,
        part_errors_deg=np.array([4.0]),
    )  # fmt: skip
    walk = [SimpleNamespace(performers=[SimpleNamespace(**vars(pose), time_s=n / 30.0)]) for n in range(400)]
    capture.run = SimpleNamespace(poses=walk, statistics=SimpleNamespace(lost=0))
    texts = SimpleNamespace(marker_set=SimpleNamespace(texts=("left hand", "head")))
    capture.setup = SimpleNamespace(performers=[texts])
    guide.seen.walk = live.judge_capture(capture)
    assert guide.seen.walk == "captures will be good, joints within about 4 degrees; nothing needs to change"
    capture.run.statistics.lost = 400
    assert "50% of the images are lost" in live.judge_capture(capture)
    guide.seen.forget()
    assert guide.seen.walk == ""


def test_a_capture_shows_the_fault_to_practise_on(part: Any, chosen: Any) -> None:
    request = part("capture.capture_request")

    def studio() -> Any:
        return request._with_targets(request.source(chosen), chosen, 0).studio

    chosen.practise_fault = "DARK"
    assert studio() == {}
    chosen.practise = True
    assert studio()["marker_brightness"] < 50.0
    chosen.practise_fault = "EXCHANGED"  # the check shows this one
    assert studio() == {}


def test_forgetting_begins_with_the_pictures(part: Any, guide: Any, chosen: Any) -> None:
    chosen.practise = True
    guide.keep_check(chosen, GOOD)
    guide.seen.forget()
    assert title(guide, chosen) == "Exposure"


def test_the_exposure_of_the_guide_is_set_with_one_click(part: Any, guide: Any, chosen: Any) -> None:
    preferences = part("preferences.preferences")
    assert {controls.exposure_s for controls in preferences.camera_controls(bpy.context)} == {None}
    assert bpy.ops.perfanim.propose_exposure() == {"FINISHED"}
    assert {controls.exposure_s for controls in preferences.camera_controls(bpy.context)} == {0.004}
    assert not bpy.ops.perfanim.propose_exposure.poll()
    for camera in preferences.cameras_of(bpy.context):
        camera.exposure_auto = True  # for other tests: preferences stay
