"""From recorded image pairs of two webcams to an own character: tracked by the command line, imported in Blender."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from heroes import save_hero
from perfanim.core.cli.main import main
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times
from two_webcams import published_rig

FIRST, LAST = 1700, 1796  # pairs of the fourth sequence by their numbers: 3 s, several steps away from the cameras
MARKERS = "two-webcams"
UP = 2  # Blender's axis

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("near_worker")]


@pytest.fixture(scope="module")
def tracked(shared_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the command line makes of one folder of pictures, as docs/marker-takes.md says.

    The cameras are those that the recording comes with.
    """
    folder, recorded = tmp_path_factory.mktemp("pairs"), shared_dir / "two-webcams"
    (folder / "pictures").mkdir()
    for path in (recorded / "sequence4").glob("*.jpg"):
        if FIRST <= int(path.name.split("_")[0]) < LAST:
            shutil.copy(path, folder / "pictures")
    rig, level, first = folder / "cameras.toml", folder / "level.toml", folder / "walk.take.npz"
    database, subject = folder / "motion.pfdb", folder / "anna.toml"
    pictures = ("--left", folder / "pictures" / "*_1.jpg", "--right", folder / "pictures" / "*_2.jpg")
    worn = ("--marker-set", MARKERS)
    save_rig(published_rig(recorded), rig)
    for words in (
        ("database", "build", *sorted(MOTION.glob("walking-*.bvh")), "--fps", 30, "--out", database),
        ("track", "--cameras", rig, *pictures, *worn, "--floor", "feet", "--floor-cameras", level, "--out", first),
        ("calibrate", "subject", first, *worn, "--database", database, "--height", 1.6, "--out", subject),
        ("track", "--cameras", level, *pictures, "--out", folder / "seen.perftake"),
    ):
        assert main([str(word) for word in words]) == 0
    return folder


@pytest.fixture
def chosen(part: Any, tracked: Path) -> Any:
    """The settings, with the performer and an own character of another program chosen."""
    save_hero(tracked / "hero.blend")
    settings = bpy.context.scene.perfanim
    settings.subject, settings.database = str(tracked / "anna.toml"), str(tracked / "motion.pfdb")
    settings.marker_set, settings.armature = MARKERS, bpy.data.objects["Hero"]
    shutil.rmtree(part("take_library").folder(), ignore_errors=True)
    part("take_library").forget()
    return settings


def imported(part: Any, folder: Path, name: str) -> tuple[str, Path]:
    """Return what the button says, and the take in the list."""
    operator = part("operators.import_takes").PERFANIM_OT_import_takes
    given = {"files": [SimpleNamespace(name=name)], "directory": str(folder), "filepath": ""}
    text = run_job(
        part,
        operator,
        SimpleNamespace(**given, up="auto", method="best", trust_labels=False, body="CHOSEN", put_on=False),
    )
    (take,) = part("take_library").listed()
    return text, take.path


def check_walk(hero: Any, path: Path) -> None:
    """It walks upright, several steps, on its feet."""
    frames = key_times(curves_of(hero))
    times_s = [solved.pose.time_s for solved in read_take_file(path).poses]
    assert len(times_s) == LAST - FIRST
    assert len(frames) == round(30 * (times_s[-1] - times_s[0])) + 1  # lost frames are interpolated
    assert np.ptp(np.diff(frames)) < 1e-3
    hips, feet = [], []
    for frame in frames[::5]:
        bpy.context.scene.frame_set(round(frame))
        posed = hero.evaluated_get(bpy.context.evaluated_depsgraph_get())
        hips.append(posed.matrix_world @ posed.pose.bones["mixamorig:Hips"].head)
        feet.append([posed.matrix_world @ posed.pose.bones[f"mixamorig:{side}Foot"].head for side in ("Left", "Right")])
    places, ankles = np.array(hips), np.array(feet)
    assert np.linalg.norm(places[-1, :UP] - places[0, :UP]) > 1.0
    assert np.all((places[:, UP] > 0.7) & (places[:, UP] < 1.1))
    assert np.all(ankles[..., UP].min(axis=1) < 0.2)
    assert np.ptp(ankles[..., UP], axis=0).min() > 0.05


def test_trajectories_of_the_pictures_are_put_on_a_character(part: Any, tracked: Path, chosen: Any) -> None:
    bpy.context.scene.render.fps = 30
    text, path = imported(part, tracked, "walk.take.npz")
    assert text == "1 take imported; good"
    assert "frames are unevenly spaced" in part("jobs.activity").message("takes")[0]
    assert bpy.ops.perfanim.play_take(path=str(path)) == {"FINISHED"}
    assert chosen.armature.name == "Hero"
    check_walk(chosen.armature, path)


def test_what_the_cameras_saw_is_solved_for_the_chosen_performer(part: Any, tracked: Path, chosen: Any) -> None:
    bpy.context.scene.render.fps = 30
    text, path = imported(part, tracked, "seen.perftake")
    assert text == "1 take imported; seen has no poses yet: solve it"
    operator = part("operators.solve_takes").PERFANIM_OT_solve_take
    given = {"path": str(path), "method": "best", "database": "CHOSEN", "performer": "CHOSEN", "cameras": "RECORDED"}
    said = run_job(part, operator, SimpleNamespace(**given, put_on=True))
    assert said.startswith(f"{LAST - FIRST} frames in ")
    check_walk(chosen.armature, part("take_library").listed()[0].path)
