"""A performer is refined by a take of the list, and used or refused."""

import os
import shutil
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import PATIENCE_S, run_job
from measured_layout import Context, Layout, cut_off, stand_in
from perfanim.core.cli.main import main
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from wrong_performer import record_walk_of_a_wrong_performer


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A walk recorded with a performer whose bones are 10 % too long, and a database with it."""
    folder = tmp_path_factory.mktemp("walk")
    made = record_walk_of_a_wrong_performer(folder)
    given = ["--subject", str(folder / "anna.toml"), "--database", str(folder / "walk.pfdb"), "--out", str(folder)]
    assert main(["take", "import", str(folder / "walk.take.npz"), *given]) == 0
    return SimpleNamespace(take=folder / "walk.perftake", **vars(made))


@pytest.fixture
def anna(part: Any, walk: SimpleNamespace) -> Path:
    """The file of the performer in use; the take is the only one in the list."""
    chosen, file = bpy.context.scene.perfanim, part("preferences.paths").user_folder("subjects") / "anna.toml"
    shutil.copy(walk.folder / "anna.toml", file)
    chosen.subject, chosen.database, chosen.marker_set = str(file), str(walk.folder / "walk.pfdb"), "locomotion"
    shutil.copy(walk.take, part("take_library").folder() / "walk.perftake")
    part("take_library").forget()
    return file


@pytest.fixture
def take(part: Any, anna: Path) -> str:
    return str(part("take_library").folder() / "walk.perftake")


def refine(part: Any, take: str) -> str:
    return run_job(part, part("operators.refine_performer").PERFANIM_OT_refine_performer, SimpleNamespace(path=take))


def refined_by(part: Any, take: str, subject: Subject, *changes: str) -> Any:
    return part("settings.performer_refinement").Refined(take, subject, changes)


def bones_off(subject: Subject, right: Subject) -> float:
    """Mean deviation of the bones' lengths, as a share."""
    found, true = (np.linalg.norm(each.skeleton.offsets_m[1:], axis=1) for each in (subject, right))
    return float(np.abs(found[true > 0.0] / true[true > 0.0] - 1.0).mean())


def test_a_wrong_body_is_refined_and_used_from_a_file_beside_the_old_one(
    part: Any, walk: SimpleNamespace, anna: Path, take: str
) -> None:
    before, offer = anna.read_bytes(), part("settings.performer_refinement").offer
    assert refine(part, take) == ""
    assert offer.refined.changes[0].startswith("whole body ")
    assert "smaller (± " in offer.refined.changes[0]
    assert bpy.context.scene.perfanim.subject == str(anna)
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    refined = anna.with_name("anna refined.toml")
    assert bpy.context.scene.perfanim.subject == str(refined)
    assert anna.read_bytes() == before
    found = load_subject(refined)
    assert (found.name, found.marker_set.names) == ("Anna", walk.right.marker_set.names)
    assert bones_off(found, walk.right) < 0.6 * bones_off(walk.wrong, walk.right)
    assert "anna refined.toml is used from now on" in part("jobs.activity").message("takes")[0]
    texts = [text for _, text, _ in part("operators.subject_operators")._profiles(None)]
    assert texts == [f"{stem}: Anna, average body" for stem in ("anna refined", "anna")]
    assert not bpy.ops.perfanim.use_refined_performer.poll()
    offer.refined = refined_by(part, take, found, "again")
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    assert bpy.context.scene.perfanim.subject == str(anna.with_name("anna refined (2).toml"))


def test_a_refused_performer_leaves_no_trace(part: Any, walk: SimpleNamespace, anna: Path, take: str) -> None:
    offer = part("settings.performer_refinement").offer
    assert not bpy.ops.perfanim.refuse_refined_performer.poll()
    offer.refined = refined_by(part, take, walk.right, "arms 4 % shorter (± 1 %)")
    assert bpy.ops.perfanim.refuse_refined_performer() == {"FINISHED"}
    assert offer.refined is None
    assert bpy.context.scene.perfanim.subject == str(anna)
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]


def test_the_refined_performer_of_another_file_is_kept_where_performers_are(
    part: Any, walk: SimpleNamespace, anna: Path, take: str, tmp_path: Path
) -> None:
    save_subject(Subject("Ben", walk.right.skeleton, walk.right.marker_set), tmp_path / "ben.toml")
    bpy.context.scene.perfanim.subject = str(tmp_path / "ben.toml")
    part("settings.performer_refinement").offer.refined = refined_by(part, take, walk.right, "arms 4 % shorter (± 1 %)")
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    assert bpy.context.scene.perfanim.subject == str(anna.with_name("Anna refined.toml"))
    assert [file.name for file in tmp_path.iterdir()] == ["ben.toml"]


def test_a_body_that_fits_is_said_to_where_the_button_was(part: Any, walk: SimpleNamespace, take: str) -> None:
    offer, operator = part("settings.performer_refinement").offer, part("operators.refine_performer")
    for captured, shown in (("", ""), (take, "Anna fits this take: nothing to change")):
        offer.capture = captured
        result = Path(bpy.app.tempdir) / "refined.toml"
        save_subject(walk.right, result)
        clicked = SimpleNamespace(path=take, _result=result)
        text = operator.PERFANIM_OT_refine_performer.on_result(clicked, bpy.context, {"changes": []})
        assert text == "Anna fits this take: nothing to change"
        assert part("jobs.activity").message("capture")[0] == shown
        assert (offer.refined, offer.capture, result.exists()) == (None, "", False)


def test_a_cancelled_refinement_changes_nothing(part: Any, anna: Path, take: str) -> None:
    assert bpy.ops.perfanim.refine_performer("EXEC_DEFAULT", path=take) == {"RUNNING_MODAL"}
    job = part("jobs.activity").current()
    assert (job.title, job.panel) == ("Refining the performer", "takes")
    assert not bpy.ops.perfanim.refine_performer.poll()
    assert bpy.ops.perfanim.cancel_job("EXEC_DEFAULT") == {"FINISHED"}
    assert part("jobs.activity").current() is None
    assert part("settings.performer_refinement").offer.refined is None
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]
    assert bpy.context.scene.perfanim.subject == str(anna)


def test_takes_that_refine_nothing_are_refused_with_the_reason(part: Any, take: str) -> None:
    folder, whole = Path(take).parent, read_take_file(take)
    write_whole_take(folder / "still.perftake", whole.setup, TakeNotes("still"), whole.stamped_frames[:2], [])
    bare = whole.setup.__class__(rig={}, performers=())
    write_whole_take(folder / "bare.perftake", bare, TakeNotes("bare"), whole.stamped_frames, [])
    (folder / "half.perftake").write_bytes(Path(take).read_bytes()[:-400])
    (folder / "words.perftake").write_text("no take")
    click = bpy.ops.perfanim.refine_performer
    for name, reason in (
        ("bare", "bare: has no performer yet; click Solve Again"),
        ("half", "half: was cut off; click Recover Take"),
        ("words", "words.perftake"),
        ("none", "none.perftake"),
    ):
        with pytest.raises(RuntimeError, match=reason):
            click("EXEC_DEFAULT", path=str(folder / f"{name}.perftake"))
    with pytest.raises(Exception, match="has no poses"):
        refine(part, str(folder / "still.perftake"))
    assert part("settings.performer_refinement").offer.refined is None


def test_a_database_that_is_gone_greys_the_button_out(part: Any, take: str, tmp_path: Path) -> None:
    operator = part("operators.refine_performer").PERFANIM_OT_refine_performer
    assert operator.missing_input(bpy.context) == ""
    bpy.context.scene.perfanim.database = str(tmp_path / "gone.pfdb")
    assert "gone.pfdb" in operator.missing_input(bpy.context)
    assert not bpy.ops.perfanim.refine_performer.poll()


def test_without_a_database_the_starter_is_made_first(part: Any, walk: SimpleNamespace, take: str) -> None:
    bpy.context.scene.perfanim.database = ""
    operator = part("operators.refine_performer").PERFANIM_OT_refine_performer
    line = operator.arguments(SimpleNamespace(path=take), bpy.context)
    assert line[line.index("--database") + 1] == str(part("settings.readiness").starter_database_path())
    assert operator.uses_starter(SimpleNamespace(), bpy.context)


def labels(panel: Any, draw: Any) -> list[str]:
    """Texts that a panel draws."""
    root = Layout("column")
    draw(stand_in(panel, root), Context())
    return root.texts()


def test_a_long_capture_offers_the_refinement_in_the_capture_panel(part: Any, walk: SimpleNamespace, take: str) -> None:
    live, chosen, offer = (
        part("capture.live_capture"),
        bpy.context.scene.perfanim,
        part("settings.performer_refinement").offer,
    )

    def captured(seconds: float, file: str = take) -> str:
        poses = [SimpleNamespace(time_s=5.0), SimpleNamespace(time_s=5.0 + seconds)]
        capture = SimpleNamespace(run=SimpleNamespace(poses=poses), take_path=file)
        return str(live.refining_take(capture, chosen))

    chosen.source = "SIMULATED"
    assert captured(30.0) == ""
    chosen.source = "CAMERAS"
    assert captured(19.0) == ""
    assert captured(30.0, f"{take}.gone") == ""
    assert live.refining_take(SimpleNamespace(run=None), chosen) == ""
    assert captured(20.0) == take
    takes, panel = part("panels.takes_panel"), part("panels.capture_panel").PERFANIM_PT_capture
    assert "Refine Performer by This Capture" not in labels(panel, takes.draw_offer)
    offer.capture = captured(20.0)
    assert "Refine Performer by This Capture" in labels(panel, takes.draw_offer)
    changes = ["arms 4 % longer (± 1 %)", "lower legs 14 % longer (± 10 %)", "marker right shoulder 12 mm (± 10 mm)"]
    offer.refined = refined_by(part, take, walk.right, *changes)
    drawn = labels(panel, takes.draw_offer)
    assert {"Use", "Keep", "Anna, refined by this take:", "Arms 4\u00a0% longer (±\u00a01\u00a0%)"} <= set(drawn)
    assert cut_off(takes.draw_offer, panel) == []
    takes._fill()
    assert "Arms 4\u00a0% longer (±\u00a01\u00a0%)" in labels(takes.PERFANIM_PT_takes, lambda each, at: each.draw(at))


def test_the_end_of_a_capture_makes_the_offer(part: Any, anna: Path, take: str) -> None:
    operator, offer = (
        part("operators.capture_operators").PERFANIM_OT_start_capture,
        part("settings.performer_refinement").offer,
    )
    bpy.context.scene.perfanim.source = "CAMERAS"
    for seconds, offered in ((21.0, take), (5.0, "")):
        poses = [SimpleNamespace(time_s=0.0), SimpleNamespace(time_s=seconds)]
        capture = SimpleNamespace(
            run=SimpleNamespace(poses=poses), keep=lambda _: "2 frames recorded", take_path=take, setup=None
        )
        ended = operator._finish(SimpleNamespace(_capture=capture, report=lambda *_: None), bpy.context)
        assert (ended, offer.capture) == ({"FINISHED"}, offered)
        assert part("jobs.activity").message("capture")[0] == "2 frames recorded"


def refined_live(part: Any, take: str, database: Path, seconds: float) -> Any:
    """Return the refinement of a capture after so many seconds, its work done."""
    refinement = part("capture.live_refinement").LiveRefinement(take, str(database), None)
    limit = time.monotonic() + PATIENCE_S
    is_offered = refinement.tick(seconds)
    while refinement._job is not None:
        assert time.monotonic() < limit
        time.sleep(0.05)
        is_offered |= refinement.tick(seconds)
    assert is_offered == (part("settings.performer_refinement").offer.refined is not None)
    return refinement


def test_a_wrong_body_is_refined_while_the_capture_goes_on(
    part: Any, walk: SimpleNamespace, anna: Path, take: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path(take).write_bytes(Path(take).read_bytes()[:-400])  # as a file that is still being written
    offer, before = part("settings.performer_refinement").offer, anna.read_bytes()
    refinement = part("capture.live_refinement").LiveRefinement(take, str(walk.folder / "walk.pfdb"), None)
    assert not refinement.tick(19.9)
    assert refinement._job is None
    refined_live(part, take, walk.folder / "walk.pfdb", 20.0)
    assert offer.capture == offer.refined.take == take
    assert bones_off(offer.refined.subject, walk.right) < 0.6 * bones_off(walk.wrong, walk.right)
    assert (anna.read_bytes(), bpy.context.scene.perfanim.subject) == (before, str(anna))
    assert [file.name for file in Path(bpy.app.tempdir).glob("refined*")] == []
    takes, panel = part("panels.takes_panel"), part("panels.capture_panel").PERFANIM_PT_capture
    drawn = labels(panel, takes.draw_offer)
    assert {"Use", "Keep", "Anna, refined by this take:"} <= set(drawn)
    monkeypatch.setattr(takes.activity, "current", lambda: object.__new__(part("capture.live_capture").LiveCapture))
    while_capturing = labels(panel, takes.draw_offer)
    assert "Anna, refined by this take:" in while_capturing
    assert not {"Use", "Keep", "Refine Performer by This Capture"} & set(while_capturing)


def test_a_capture_that_refines_nothing_goes_on(part: Any, walk: SimpleNamespace, take: str, tmp_path: Path) -> None:
    (tmp_path / "words.perftake").write_text("no take")
    for file, database in (
        (tmp_path / "words.perftake", walk.folder / "walk.pfdb"),
        (take, tmp_path / "gone.pfdb"),
    ):
        refinement = refined_live(part, str(file), database, 25.0)
        assert not refinement.tick(59.0)
        assert refinement._job is None
    nothing = part("capture.live_refinement").LiveRefinement(f"{take}.gone", str(walk.folder / "walk.pfdb"), None)
    assert not nothing.tick(30.0)
    assert nothing._job is None


def test_the_end_of_a_capture_ends_its_refinement(part: Any, walk: SimpleNamespace, take: str) -> None:
    refinement = part("capture.live_refinement").LiveRefinement(take, str(walk.folder / "walk.pfdb"), None)
    refinement.tick(20.0)
    process = refinement._job._client._process
    if hasattr(os, "getpriority"):
        own, limit = os.getpriority(os.PRIO_PROCESS, 0), time.monotonic() + PATIENCE_S
        while os.getpriority(os.PRIO_PROCESS, process.id) <= own:  # it lets solver and Blender go first
            assert process.status is None and time.monotonic() < limit
            refinement.tick(20.0)
            time.sleep(0.02)
    assert process.status is None
    refinement.close()
    assert process.status is not None
    assert part("settings.performer_refinement").offer.refined is None
