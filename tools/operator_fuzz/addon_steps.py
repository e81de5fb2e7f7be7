"""Steps that use the add-on: its buttons, its settings, its timers, and switching it off and on."""

import random
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import addon_utils
import bpy

from .values import arguments_for, set_one

ADDON = "bl_ext.user_default.perfanim"
# these start a worker process, which takes a second each
_WORKERS = {
    *("average_performer", "bake_sketch", "build_database", "calibrate_board", "calibrate_cameras"),
    *("calibrate_performer", "calibrate_subject", "import_takes", "live_sketch", "measure_target", "record_t_pose"),
    *("recover_take", "run_batch", "save_board", "self_test", "set_floor", "set_floor_markers", "solve_sketch"),
    *("solve_take", "start_capture"),
}
_NEVER = {"get_motion"}  # it contacts a server
_SCENE_GROUPS = tuple(f"perfanim{name}" for name in ("", "_targets", "_batch", "_result", "_sending", "_receiving"))
_TICK_S = 0.02
_SECOND_S = 120.0  # time after which another Blender counts as hung


def part(name: str) -> Any:
    """Return a module of the add-on, or None while it is off."""
    return sys.modules.get(f"{ADDON}.perfanim_addon.{name}") if is_on() else None


def is_on() -> bool:
    """Return whether the add-on is on."""
    return ADDON in bpy.context.preferences.addons and hasattr(bpy.types.Scene, "perfanim")


def samples(folder: Path) -> list[str]:
    """Return paths that a user could choose."""
    return [str(path) for path in sorted((folder / "samples").iterdir())] + [str(folder / "chosen")]


def click(chance: random.Random, folder: Path, among: Callable[[str], bool]) -> str:
    """Call an operator as a button does; return its name and how it ended.

    Raises:
        AssertionError: It raised something that buttons do not report.
    """
    if not is_on():
        return "off"
    names = [name for name in dir(bpy.ops.perfanim) if name not in _NEVER and among(name)]
    name = chance.choice(names)
    operator = getattr(bpy.ops.perfanim, name)
    arguments = arguments_for(chance, operator, samples(folder))
    takes = part("take_library").listed()
    if takes and "path" in arguments and chance.random() < 0.8:
        arguments["path"] = str(chance.choice(takes).path)
    try:
        ended = operator("EXEC_DEFAULT", **arguments)
    except (RuntimeError, TypeError) as error:  # rejected, reported, or an unavailable choice
        if "Traceback" in str(error):
            raise AssertionError(f"{name}({arguments}): {error}") from error
        ended = {"refused"}
    return f"{name}({arguments}): {', '.join(ended)}"


def click_quick(chance: random.Random, folder: Path) -> str:
    """Click on a button that acts immediately."""
    return click(chance, folder, lambda name: name not in _WORKERS)


def click_work(chance: random.Random, folder: Path) -> str:
    """Click on a button that starts a worker."""
    return click(chance, folder, lambda name: name in _WORKERS)


def change_setting(chance: random.Random, folder: Path) -> str:
    """Change a setting of the scene, the targets, the character or the preferences."""
    if not is_on():
        return "off"
    scene = bpy.context.scene
    groups = [getattr(scene, name) for name in _SCENE_GROUPS if hasattr(scene, name)]
    groups += scene.perfanim_targets.entries
    groups += [obj.perfanim_sketch for obj in bpy.data.objects if obj.type == "ARMATURE"]
    if chance.random() < 0.15:
        groups = [bpy.context.preferences.addons[ADDON].preferences]
    return set_one(chance, chance.choice(groups), samples(folder))


def choose_character(chance: random.Random, folder: Path) -> None:
    """Choose an armature under Character, or none."""
    armatures = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    if is_on():
        bpy.context.scene.perfanim.armature = chance.choice([None, *armatures])


def tick(chance: random.Random, folder: Path) -> None:
    """Send running work some events of its timer, because without a window none arrive."""
    if not is_on():
        return
    for _ in range(chance.choice((1, 5, 25))):
        running, live = part("jobs.activity").current(), part("sketch.live_sketch")
        if running is None and live.current() is None:
            return
        if live.current() is not None:
            live._tick()
        if running is not None:
            _modal(running)
        time.sleep(_TICK_S)


def _modal(running: Any) -> None:
    """Give a timer's event to the operator of the running capture or job."""
    if hasattr(running, "recordings"):
        operator = part("operators.capture_operators").PERFANIM_OT_start_capture
        own = {"_capture": running, "_shown_at": 0.0, "_status": ""}
    else:  # results known only to the started operator are shown in a window
        operator, own = part("operators.job_operators").JobOperator, {"_job": running, "panel": running.panel}
    _StandIn(operator, own).modal(bpy.context, SimpleNamespace(type="TIMER", value="NOTHING"))


class _StandIn:
    """Substitute for an operator, because Python can neither create nor access one."""

    def __init__(self, operator: Any, own: dict[str, Any]) -> None:
        self.__dict__.update(own, _operator=operator)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._operator, name)
        return partial(found, self) if callable(found) and not hasattr(found, "__self__") else found

    def report(self, kinds: set[str], text: str) -> None:
        """Receive a report."""


def switch(chance: random.Random, folder: Path) -> None:
    """Switch the add-on off, usually to switch it on again immediately."""
    if is_on():
        addon_utils.disable(ADDON, default_set=True)
        if chance.random() < 0.3:
            return
    addon_utils.enable(ADDON, default_set=True)


def harm_takes(chance: random.Random, folder: Path) -> None:
    """Delete or truncate a take behind the add-on's back."""
    if not is_on():
        return
    takes = sorted(part("take_library").folder().glob("*.perftake"))
    if takes:
        path = chance.choice(takes)
        if chance.random() < 0.5:
            path.unlink()
        else:
            path.write_bytes(path.read_bytes()[: chance.randrange(2000)])


def second_blender(chance: random.Random, folder: Path) -> str:
    """Start another Blender with the same folders; wait until it has changed a take.

    Raises:
        AssertionError: The second Blender fails.
    """
    if not is_on():
        return "off"
    extensions = Path(sys.modules[ADDON].__file__ or "").parents[1]
    script = [str(Path(__file__).with_name("second_blender.py")), str(extensions), str(chance.random())]
    blender = bpy.app.binary_path  # None as a module
    command = [blender, "--background", "--python-exit-code", "1", "--python", script[0], "--", *script[1:]]
    done = subprocess.run(
        command if blender else [sys.executable, *script],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=_SECOND_S,
    )
    said = [line for line in done.stdout.splitlines() if line.startswith("second Blender: ")]
    if done.returncode or not said or "Traceback" in done.stderr:
        raise AssertionError(f"a second Blender ended with {done.returncode}: {done.stderr[-1500:]}")
    return said[0]


# step -> relative frequency
ADDON_STEPS = {
    click_quick: 40,
    click_work: 2,
    change_setting: 24,
    choose_character: 6,
    tick: 6,
    switch: 2,
    harm_takes: 1,
    second_blender: 1,
}
