"""One sequence of random steps, and what remains after it."""

import random
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import addon_utils
import bpy
from remains import children, remains

from .addon_steps import ADDON, ADDON_STEPS, is_on, part
from .scene_steps import SCENE_STEPS

_TESTS = Path(__file__).resolve().parents[2] / "tests"
_STEPS: dict[Callable[..., Any], int] = {**SCENE_STEPS, **ADDON_STEPS}
_MOST_STEPS = 14
_ENDING_S = 5.0  # time until processes and threads that were ended are gone


def clear() -> None:
    """Load an empty scene and fresh settings."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def begin(folder: Path) -> None:
    """Begin in an empty scene with the same files and takes."""
    addon_utils.enable(ADDON, default_set=True)
    takes = part("take_library").folder()
    for each in (folder / "samples", folder / "chosen", takes):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir(parents=True)
    _fill(folder / "samples")
    for name in ("one.perftake", "two-and-sword.perftake", "damaged.perftake"):
        shutil.copy(folder / "samples" / name, takes)
    part("take_library").forget()
    bpy.ops.ed.undo_push(message="begin")  # without a window, the first one enables undo


def _fill(samples: Path) -> None:
    """Copy small files of all kinds, intact and damaged, from which the steps choose."""
    for pattern in ("compatibility/files/*", "fuzz/corpus/*"):
        for path in _TESTS.glob(pattern):
            shutil.copy(path, samples)
    (samples / "damaged.perftake").write_bytes((samples / "one.perftake").read_bytes()[:3000])
    (samples / "damaged.toml").write_text("kind = [[[")


def steps_of(seed: int, number: int) -> tuple[random.Random, list[Callable[..., Any]]]:
    """Return the steps of a sequence, and the random generator for their choices."""
    chance = random.Random(f"{seed}/{number}")  # noqa: S311 - repeatable, no secret
    count = chance.randint(3, _MOST_STEPS)
    return chance, chance.choices(list(_STEPS), list(_STEPS.values()), k=count)


def take_step(step: Callable[..., Any], chance: random.Random, folder: Path) -> str:
    """Take one step and return a line about it.

    Raises:
        Exception: Something that no user should encounter.
    """
    try:
        line = step(chance, folder)
    except RuntimeError as error:  # Blender's own operators refuse to run in a wrong mode
        if "Traceback" in str(error):
            raise
        line = str(error).strip()
    return f"{step.__name__} {line or ''}".strip()


def end() -> None:
    """End as when another file is loaded and the add-on is switched off."""
    clear()
    if is_on():
        addon_utils.disable(ADDON, default_set=True)


def left_over(before: dict[str, Any], folder: Path) -> list[str]:
    """Return the add-on's things that a sequence created and left behind."""
    limit_s = time.monotonic() + _ENDING_S
    while children() and time.monotonic() < limit_s:
        time.sleep(0.02)
    after = remains()
    found = [
        f"{key}: {after.get(key)} after, {before.get(key)} before"
        for key in {*before, *after}
        if after.get(key) != before.get(key)
    ]
    temporary = [*folder.glob("user/**/.*.*"), *folder.glob("tmp/*"), *folder.glob("chosen/.*")]
    ours = [path for path in temporary if not path.is_symlink() and not _is_blenders(path)]
    for path in ours:  # reported once
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return found + [f"file: {path}" for path in ours]


def _is_blenders(path: Path) -> bool:
    return path.parent.name == "tmp" and (path.name.startswith("blender_") or path.suffix == ".blend")
