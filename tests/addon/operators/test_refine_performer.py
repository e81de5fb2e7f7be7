"""A performer is refined by a take of the list, and used or refused."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from measured_layout import Context, Layout, cut_off, stand_in
from perfanim.core.cli.main import main
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from ticking import repeat
from wrong_performer import record_walk_of_a_wrong_performer

REFINED = "Anna, refined with this take:"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A walk recorded with a performer whose bones are 10 % too long, and a database with it."""
    folder = tmp_path_factory.mktemp("walk")
    made = record_walk_of_a_wrong_performer(folder)
    given = ["--subject", str(folder / "anna.toml"), "--database", str(folder / "walk.pfdb"), "--out", str(folder)]
    assert main(["take", "import", str(folder / "walk.take.npz"), *given]) == 0
    return SimpleNamespace(take=folder / "walk.perftake", **vars(made))


@pytest.fixture
def anna(part: Any, chosen: Any, walk: SimpleNamespace) -> Path:
    """The file of the performer in use; the take is the only one in the list."""
    file = part("preferences.paths").user_folder("subjects") / "anna.toml"
    shutil.copy(walk.folder / "anna.toml", file)
    chosen.subject, chosen.database, chosen.marker_set = str(file), str(walk.folder / "walk.pfdb"), "locomotion"
    shutil.copy(walk.take, part("take_library").folder() / "walk.perftake")
    part("take_library").forget()
    return file


@pytest.fixture
def take(part: Any, anna: Path) -> str:
    return str(part("take_library").folder() / "walk.perftake")


@pytest.fixture
def offer(part: Any) -> Any:
    """What is offered in the panels."""
    return part("settings.performer_refinement").offer


@pytest.fixture
def offered(part: Any, offer: Any, walk: SimpleNamespace, take: str) -> Callable[..., None]:
    """Offer the right performer, with these changes."""

    def refine(*changes: str) -> None:
        offer.refined = part("settings.performer_refinement").Refined(take, walk.right, changes)

    return refine


@pytest.fixture
def operator(part: Any) -> Any:
    return part("operators.refine_performer").PERFANIM_OT_refine_performer


def bones_off(subject: Subject, right: Subject) -> float:
    """Mean deviation of the bones' lengths, as a share."""
    found, true = (np.linalg.norm(each.skeleton.offsets_m[1:], axis=1) for each in (subject, right))
    return float(np.abs(found[true > 0.0] / true[true > 0.0] - 1.0).mean())


@pytest.mark.usefixtures("near_worker")
def test_a_wrong_body_is_refined_and_used_from_a_file_beside_the_old_one(
    part: Any, chosen: Any, offer: Any, offered: Any, operator: Any, walk: SimpleNamespace, anna: Path, take: str
) -> None:
    before = anna.read_bytes()
    assert run_job(part, operator, SimpleNamespace(path=take)) == ""
    assert offer.refined.changes[0].startswith("whole body ")
    assert "smaller (± " in offer.refined.changes[0]
    assert chosen.subject == str(anna)
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    refined = anna.with_name("anna refined.toml")
    assert chosen.subject == str(refined)
    assert anna.read_bytes() == before
    found = load_subject(refined)
    assert (found.name, found.marker_set.names) == ("Anna", walk.right.marker_set.names)
    assert bones_off(found, walk.right) < 0.6 * bones_off(walk.wrong, walk.right)
    assert "anna refined.toml is used from now on" in part("jobs.activity").message("takes")[0]
    texts = [text for _, text, _ in part("operators.subject_operators")._profiles(None)]
    assert texts == [f"{stem}: Anna, average body" for stem in ("anna refined", "anna")]
    assert not bpy.ops.perfanim.use_refined_performer.poll()
    offered("again")
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    assert chosen.subject == str(anna.with_name("anna refined (2).toml"))


def test_a_refused_performer_leaves_no_trace(chosen: Any, offer: Any, offered: Any, anna: Path, take: str) -> None:
    assert not bpy.ops.perfanim.refuse_refined_performer.poll()
    offered("arms 4 % shorter (± 1 %)")
    assert bpy.ops.perfanim.refuse_refined_performer() == {"FINISHED"}
    assert offer.refined is None
    assert chosen.subject == str(anna)
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]


def test_the_refined_performer_of_another_file_is_kept_where_performers_are(
    chosen: Any, offered: Any, walk: SimpleNamespace, anna: Path, take: str, tmp_path: Path
) -> None:
    save_subject(Subject("Ben", walk.right.skeleton, walk.right.marker_set), tmp_path / "ben.toml")
    chosen.subject = str(tmp_path / "ben.toml")
    offered("arms 4 % shorter (± 1 %)")
    assert bpy.ops.perfanim.use_refined_performer() == {"FINISHED"}
    assert chosen.subject == str(anna.with_name("Anna refined.toml"))
    assert [file.name for file in tmp_path.iterdir()] == ["ben.toml"]


def test_a_body_that_fits_is_said_to_where_the_button_was(
    offer: Any, operator: Any, message: Any, walk: SimpleNamespace, take: str
) -> None:
    for captured, shown in (("", ""), (take, "Anna fits this take: nothing to change")):
        offer.capture = captured
        result = Path(bpy.app.tempdir) / "refined.toml"
        save_subject(walk.right, result)
        clicked = SimpleNamespace(path=take, _result=result)
        text = operator.on_result(clicked, bpy.context, {"changes": []})
        assert text == "Anna fits this take: nothing to change"
        assert message("capture") == shown
        assert (offer.refined, offer.capture, result.exists()) == (None, "", False)


def test_a_cancelled_refinement_changes_nothing(part: Any, chosen: Any, offer: Any, anna: Path, take: str) -> None:
    assert bpy.ops.perfanim.refine_performer("EXEC_DEFAULT", path=take) == {"RUNNING_MODAL"}
    job = part("jobs.activity").current()
    assert (job.title, job.panel) == ("Refining the performer", "takes")
    assert not bpy.ops.perfanim.refine_performer.poll()
    assert bpy.ops.perfanim.cancel_job("EXEC_DEFAULT") == {"FINISHED"}
    assert part("jobs.activity").current() is None
    assert offer.refined is None
    assert [file.name for file in anna.parent.iterdir()] == ["anna.toml"]
    assert chosen.subject == str(anna)


@pytest.mark.usefixtures("near_worker")
def test_takes_that_refine_nothing_are_refused_with_the_reason(part: Any, offer: Any, operator: Any, take: str) -> None:
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
        run_job(part, operator, SimpleNamespace(path=str(folder / "still.perftake")))
    assert offer.refined is None


def test_a_database_that_is_gone_greys_the_button_out(chosen: Any, operator: Any, take: str, tmp_path: Path) -> None:
    assert operator.missing_input(bpy.context) == ""
    chosen.database = str(tmp_path / "gone.pfdb")
    assert "gone.pfdb" in operator.missing_input(bpy.context)
    assert not bpy.ops.perfanim.refine_performer.poll()


def test_without_a_database_the_starter_is_made_first(part: Any, chosen: Any, operator: Any, take: str) -> None:
    chosen.database = ""
    line = operator.arguments(SimpleNamespace(path=take), bpy.context)
    assert line[line.index("--database") + 1] == str(part("settings.readiness").starter_database_path())
    assert operator.uses_starter(SimpleNamespace(), bpy.context)


def labels(panel: Any, draw: Any) -> list[str]:
    """Texts that a panel draws."""
    root = Layout("column")
    draw(stand_in(panel, root), Context())
    return root.texts()


def test_a_long_capture_offers_the_refinement_in_the_capture_panel(
    part: Any, chosen: Any, offer: Any, offered: Any, take: str
) -> None:
    live = part("capture.live_capture")

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
    assert "Refine Performer with This Capture" not in labels(panel, takes.draw_offer)
    offer.capture = captured(20.0)
    assert "Refine Performer with This Capture" in labels(panel, takes.draw_offer)
    offered("arms 4 % longer (± 1 %)", "lower legs 14 % longer (± 10 %)", "marker right shoulder 12 mm (± 10 mm)")
    drawn = labels(panel, takes.draw_offer)
    assert {"Use", "Keep", REFINED, "Arms 4\u00a0% longer (±\u00a01\u00a0%)"} <= set(drawn)
    assert cut_off(takes.draw_offer, panel) == []
    takes._fill()
    assert "Arms 4\u00a0% longer (±\u00a01\u00a0%)" in labels(takes.PERFANIM_PT_takes, lambda each, at: each.draw(at))


def test_the_end_of_a_capture_makes_the_offer(part: Any, chosen: Any, offer: Any, message: Any, take: str) -> None:
    start = part("operators.capture_operators").PERFANIM_OT_start_capture
    chosen.source = "CAMERAS"
    for seconds, offered in ((21.0, take), (5.0, "")):
        poses = [SimpleNamespace(time_s=0.0), SimpleNamespace(time_s=seconds)]
        capture = SimpleNamespace(
            run=SimpleNamespace(poses=poses),
            keep=lambda _: "2 frames recorded",
            take_path=take,
            setup=None,
            actions=(),
        )
        ended = start._finish(SimpleNamespace(_capture=capture, report=lambda *_: None), bpy.context)
        assert (ended, offer.capture) == ({"FINISHED"}, offered)
        assert message("capture") == "2 frames recorded"


def refined_live(part: Any, take: str, database: Path, seconds: float) -> Any:
    """Return the refinement of a capture after so many seconds, its work done."""
    refinement = part("capture.live_refinement").LiveRefinement(take, str(database), None)
    offers = [refinement.tick(seconds)]
    repeat(lambda: offers.append(refinement.tick(seconds)), lambda: refinement._job is None)
    assert any(offers) == (part("settings.performer_refinement").offer.refined is not None)
    return refinement


@pytest.mark.long
def test_a_wrong_body_is_refined_while_the_capture_goes_on(
    part: Any, chosen: Any, offer: Any, walk: SimpleNamespace, anna: Path, take: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path(take).write_bytes(Path(take).read_bytes()[:-400])  # as a file that is still being written
    before = anna.read_bytes()
    refinement = part("capture.live_refinement").LiveRefinement(take, str(walk.folder / "walk.pfdb"), None)
    assert not refinement.tick(19.9)
    assert refinement._job is None
    refined_live(part, take, walk.folder / "walk.pfdb", 20.0)
    assert offer.capture == offer.refined.take == take
    assert bones_off(offer.refined.subject, walk.right) < 0.6 * bones_off(walk.wrong, walk.right)
    assert (anna.read_bytes(), chosen.subject) == (before, str(anna))
    assert [file.name for file in Path(bpy.app.tempdir).glob("refined*")] == []
    takes, panel = part("panels.takes_panel"), part("panels.capture_panel").PERFANIM_PT_capture
    drawn = labels(panel, takes.draw_offer)
    assert {"Use", "Keep", REFINED} <= set(drawn)
    monkeypatch.setattr(takes.activity, "current", lambda: object.__new__(part("capture.live_capture").LiveCapture))
    while_capturing = labels(panel, takes.draw_offer)
    assert REFINED in while_capturing
    assert not {"Use", "Keep", "Refine Performer with This Capture"} & set(while_capturing)


def test_a_capture_that_refines_nothing_goes_on(part: Any, walk: SimpleNamespace, take: str, tmp_path: Path) -> None:
    (tmp_path / "words.perftake").write_text("no take")
    for file, database in ((tmp_path / "words.perftake", walk.folder / "walk.pfdb"), (take, tmp_path / "gone.pfdb")):
        refinement = refined_live(part, str(file), database, 25.0)
        assert not refinement.tick(59.0)
        assert refinement._job is None
    nothing = part("capture.live_refinement").LiveRefinement(f"{take}.gone", str(walk.folder / "walk.pfdb"), None)
    assert not nothing.tick(30.0)
    assert nothing._job is None


def test_the_end_of_a_capture_ends_its_refinement(part: Any, offer: Any, walk: SimpleNamespace, take: str) -> None:
    refinement = part("capture.live_refinement").LiveRefinement(take, str(walk.folder / "walk.pfdb"), None)
    refinement.tick(20.0)
    process = refinement._job._client._process
    if hasattr(os, "getpriority"):
        own = os.getpriority(os.PRIO_PROCESS, 0)  # it lets solver and Blender go first
        repeat(lambda: refinement.tick(20.0), lambda: os.getpriority(os.PRIO_PROCESS, process.id) > own)
    assert process.status is None
    refinement.close()
    assert process.status is not None
    assert offer.refined is None
