"""Files that the commands of the documents read, made by the simulated studio."""

import importlib.util
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_take import MarkerTake, load_take, save_take
from perfanim.core.markers.prop import load_prop
from perfanim.core.simulate.studio.export_recording import RecordingFiles, export_recording
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.system.assets import MARKER_SETS, MOTION

Run = Callable[..., None]  # words of a perfanim command

_FPS = 30.0
_CLIPS = ("walking-01-neutral", "walking-03-*", "boxing-01-neutral", "running-01-brisk")
_POSES = {"behaviour": "walking", "seconds": 5.0, "poses": ["t", "hanging", "motorcycle"]}
_KEYS = "# fps=30\ncontrol,frame,x,y,z\nroot,0,0,0.9,0\nroot,30,0,0.9,1.3\nrhand,0,-0.3,0.8,0\nrhand,30,-0.3,0.9,1.4\n"
_TRUTHS = {
    "cameras.toml": "cameras.toml",
    "subject.toml": "anna.toml",
    "motion.bvh": "walk.bvh",
    "markers.take.npz": "take.take.npz",
}


def make_inputs(folder: Path, run: Run, with_videos: bool) -> None:
    """Write the files that documents name into a folder.

    Args:
        run: runs a perfanim command in the folder.
        with_videos: also videos and board pictures, which takes a minute.
    """
    _make_motion(folder)
    run("database", "build", "my-motion-folder", "--fps", "30", "--out", "motion.pfdb")
    run("simulate", "markers", "walk.bvh", "--marker-set", "boxing", "--out", "take.take.npz")
    run(
        "calibrate",
        "subject",
        "take.take.npz",
        "--marker-set",
        "boxing",
        "--database",
        "motion.pfdb",
        "--out",
        "anna.toml",
    )
    if with_videos:
        _film(folder, "studio", {"behaviour": "walking", "seconds": 8.0}, ("left", "right"), 24)
        for name, ours in _TRUTHS.items():
            shutil.copy(folder / "studio" / "truth" / name, folder / ours)
        shutil.copytree(folder / "studio" / "board", folder / "board")
        _film(folder, "poses", _POSES, ("poses-left", "poses-right"), 0)
        shutil.rmtree(folder / "studio")
        shutil.rmtree(folder / "poses")
        _make_character(folder, run)
    _make_takes(folder, run)


def _make_motion(folder: Path) -> None:
    """Write clips as a folder and an archive, and one as walk, motion and truth."""
    clips = folder / "my-motion-folder"
    clips.mkdir()
    for pattern in _CLIPS:
        path = next(MOTION.glob(f"{pattern}.bvh"))
        write_bvh(sliced(resampled(read_motion(path), _FPS), 0, 60), clips / path.name)
    with zipfile.ZipFile(folder / "downloads.zip", "w") as archive:
        archive.write(clips / "boxing-01-neutral.bvh", "boxing.bvh")
    for name in ("walk.bvh", "motion.bvh", "truth.bvh"):
        shutil.copy(clips / "walking-01-neutral.bvh", folder / name)
    shutil.copytree(clips, folder / "motion")
    for name in ("keys.csv", "more-keys.csv"):
        (folder / name).write_text(_KEYS, encoding="utf-8")


def _film(folder: Path, name: str, spec: dict[str, object], videos: tuple[str, str], board_views: int) -> None:
    """Film the simulated performer; the two videos get the names that documents give."""
    source = open_simulated({"fps": _FPS, **spec})
    export_recording(source, folder / name, RecordingFiles(background_frames=2, board_views=board_views))
    for camera, video in zip(("left", "right"), videos, strict=True):
        shutil.copy(folder / name / f"{camera}.mkv", folder / f"{video}.mp4")
        shutil.copy(folder / name / "background" / f"{camera}.mkv", folder / f"empty-{camera}.mp4")


def _make_character(folder: Path, run: Run) -> None:
    """Write a character as glTF, where Blender is at hand as a module."""
    if importlib.util.find_spec("bpy") is None:
        return
    module = "perfanim.perfanim_addon.export.retarget_file"
    subprocess.run([sys.executable, "-m", module, "motion.bvh", "new.blend"], cwd=folder, check=True, stdout=sys.stderr)
    for name in ("character.glb", "hero.glb"):
        run("retarget", "motion.bvh", "--to", "new.blend", "--out", name)


def _make_takes(folder: Path, run: Run) -> None:
    """Write takes in several formats, a recorded take, and a sword's take."""
    source = open_simulated({"fps": _FPS, **_POSES})
    times_s = np.arange(source.frames) / _FPS
    performance = source.performance
    poses = MarkerTake("poses", _FPS, performance.marker_names, performance.markers_at(times_s))
    save_take(poses, folder / "poses.take.npz")
    take = load_take(folder / "take.take.npz")
    for name in ("walk.c3d", "run.trc"):
        write_take(take, folder / name)
    (folder / "takes").mkdir()
    shutil.copy(folder / "walk.c3d", folder / "takes")
    for name in ("ben.toml", "walker.toml"):
        shutil.copy(folder / "anna.toml", folder / name)
    shutil.copy(MARKER_SETS / "boxing.toml", folder / "mine.toml")
    run("take", "import", "walk.c3d", "--subject", "anna.toml", "--database", "motion.pfdb", "--out", "imported")
    shutil.move(folder / "imported" / "walk.perftake", folder / "walk.perftake")
    sword = load_prop("sword")
    turns = rot.from_rotation_vector(np.linspace([0.0, 0.0, 0.0], [1.0, 2.0, 0.5], 60))
    positions_m = rot.rotate(turns[:, None], sword.positions_m) + np.array([0.0, 1.0, 0.0])
    names = tuple(f"B{number + 1:02d}" for number in range(len(sword.names)))
    save_take(MarkerTake("sword", _FPS, names, positions_m), folder / "sword.take.npz")
