"""Technical director: a folder of C3D takes to FBX files of a character."""

import json
import shutil
from pathlib import Path

from perfanim.core.body.motion import resampled, sliced
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.system.assets import MOTION

from .page import ROOT, Walk, WalkError

_FPS = 60.0
_SECONDS = 3.0
_SUIT = "plug-in-gait"
_TAKES = {"walk": ("walking-01-neutral", 0.0), "walk-2": ("walking-01-neutral", 2.0), "box": ("boxing-01-neutral", 0.0)}
_PLAN = """out = "solved"
database = "motion.pfdb"
subject = "anna.toml"
up = "auto"
to = '{hero}'
save_as = "fbx"
naming = "unreal"

[[take]]
take = "takes/[!b]*.c3d"

[[take]]
take = "takes/box.c3d"
subject = "ben.toml"
"""
_CUT_OFF = "cut-off.c3d"
_SUBJECT = ("--marker-set", "auto", "--database", "motion.pfdb", "--height", "1.75")


def walk_through(folder: Path, takes: Path | None = None, character: Path | None = None) -> None:
    """Go through the steps of docs/marker-takes.md and docs/batch.md.

    Args:
        takes: a folder of C3D files, the last of them with much motion; simulated ones by default.
        character: a file that `perfanim retarget` takes; the project's own by default.

    Raises:
        WalkError: a step did not end as the documents say.
    """
    walk = Walk("Technical director: a folder of C3D to FBX on a character", folder)
    walk.step(
        "The folder of takes", "Suits of 40 markers of two people, as Vicon writes them; a full disk cut one file off."
    )
    _copy_takes(takes, folder / "takes")
    files = sorted((folder / "takes").glob("*.c3d"))
    walk.note("\n".join(f"{path.name}  {path.stat().st_size:,} bytes" for path in files))
    walk.step("Facts about the takes")
    walk.run("perfanim", "take", "info", *files)
    walk.step("A motion database", "Of the motion that comes with Perfanim; perfanim database get has recorded people.")
    walk.run("perfanim", "database", "build", MOTION, "--fps", "30", "--out", "motion.pfdb")
    walk.step("Who wore the suit", "Bones and markers are fitted to a take; its labels choose the marker set.")
    walk.run("perfanim", "calibrate", "subject", files[-1], *_SUBJECT, "--out", "anna.toml")
    walk.step("The character")
    hero = _character(walk, character)
    walk.step("All takes at once", "A bad take does not hold up the others; then the exit status is 1.")
    shared = ("--subject", "anna.toml", "--database", "motion.pfdb", "--up", "auto")
    onto = ("--to", hero, "--save-as", "fbx", "--naming", "unreal")
    bad = 0 if takes else 1
    walk.run("perfanim", "batch", "takes", *shared, *onto, "--out", "solved", status=bad)
    walk.step("The report is read")
    doubtful = _read_report(walk, bad)
    if not takes:
        _mend_boxer(walk, hero, doubtful)
    walk.step("The FBX files", "Each opened in Blender again.")
    for file in sorted((folder / "solved").glob("*.fbx")):
        picture = folder / f"{file.stem}.png"
        walk.run("python", "-m", "walks.fbx_picture", file, picture, at=ROOT / "tools")
        walk.show([picture])


def _mend_boxer(walk: Walk, hero: Path, doubtful: list[str]) -> None:
    """Give the doubtful take its own performer by a plan; only it is done again."""
    if doubtful != ["box"]:
        raise WalkError(f"the boxer is somebody else, but doubtful are {doubtful}")
    walk.step("The doubtful take", "The report says to check the performer: the boxer is another person.")
    walk.run("perfanim", "calibrate", "subject", "takes/box.c3d", *_SUBJECT, "--out", "ben.toml")
    plan = _PLAN.format(hero=hero)
    (walk.folder / "plan.toml").write_text(plan, encoding="utf-8")
    walk.note(plan)
    if "3 were done before" not in walk.run("perfanim", "batch", "plan.toml", status=1):
        raise WalkError("the batch did not go on where it was")
    walk.step("The report again")
    if doubtful := _read_report(walk, 1):
        raise WalkError(f"still doubtful: {doubtful}")


def _copy_takes(takes: Path | None, target: Path) -> None:
    if takes is not None:
        shutil.copytree(takes, target)
        return
    target.mkdir()
    for name, (clip, begin_s) in _TAKES.items():
        motion = resampled(read_motion(MOTION / f"{clip}.bvh"), _FPS)
        first = round(begin_s * _FPS)
        part = sliced(motion, first, first + round(_SECONDS * _FPS))
        take, _ = simulate_markers(part, load_marker_set(_SUIT), noise_mm=1.0)
        write_take(take, target / f"{name}.c3d")
    (target / _CUT_OFF).write_bytes((target / "walk.c3d").read_bytes()[:700])


def _character(walk: Walk, character: Path | None) -> Path:
    """Return the character's file; by default it is made first."""
    if character is not None:
        return character
    clip = MOTION / f"{_TAKES['walk'][0]}.bvh"
    walk.run("python", "-m", "perfanim.perfanim_addon.export.retarget_file", clip, "hero.blend")
    return walk.folder / "hero.blend"


def _read_report(walk: Walk, bad: int) -> list[str]:
    """Show the report, compare it with the files there, and return the doubtful takes."""
    solved = walk.folder / "solved"
    summary = json.loads((solved / "summary.json").read_text(encoding="utf-8"))
    rows = summary["takes"]
    walk.note("\n".join(f"{row['name']}: {row['status']}  {'; '.join(row['reasons'])}" for row in rows))
    walk.link(solved / "summary.html", "The page of the batch, solved/summary.html")
    walk.show(sorted((solved / "report").glob("*.jpg")))
    usable = [row for row in rows if row["status"] != "bad"]
    if len(rows) - len(usable) != bad or not usable:
        raise WalkError(f"of {len(rows)} takes {len(usable)} are usable")
    for row in usable:
        if not (solved / f"{row['name']}.fbx").is_file():
            raise WalkError(f"{row['name']} has no FBX file")
    return [row["name"] for row in rows if row["status"] == "doubtful"]
