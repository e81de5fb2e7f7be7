"""`perfanim retarget`: a motion onto a character."""

import argparse
import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import CharacterError
from ..formats.markers.marker_files import check_ending
from ..retarget.joint_naming import NAMINGS
from ..system import helper_process
from ..system.files import is_file
from ..system.progress import Progress
from .options import add_character_options, add_text

BLENDER_VARIABLE = "PERFANIM_BLENDER"  # of the environment: the program to retarget with where none is named

_RETARGET = "perfanim.perfanim_addon.export.retarget_file:main"
_EXPORTED = (".fbx", ".glb", ".bvh")


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("retarget", help="a motion onto a character (needs bpy or Blender)")
    parser.add_argument("motion", metavar="MOTION", help="motion: .bvh or .amc")
    add_text(parser, "--to", "CHARACTER", "humanoid of a .blend, .glb, .gltf, .vrm or .fbx file", required=True)
    add_character_options(parser)
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of an .amc motion")
    add_text(parser, "--render", "FILE.png", "also render a picture")
    add_text(parser, "--frame", "N", "frame of the picture, from 1 (default: the middle one)", type=int)
    parser.add_argument(
        "--naming",
        choices=tuple(NAMINGS),
        help="names of the bones in a file for other programs (default: the character's own)",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="FILE.blend",
        help=f"file to write: a scene (.blend), or the character for other programs ({', '.join(_EXPORTED)})",
    )
    parser.set_defaults(run=run, wrong_usage=parser.error)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Retarget in a process of its own: bpy takes over the one it is loaded into."""
    ending = Path(args.out).suffix.lower()
    check_ending(args.out, (".blend", *_EXPORTED))
    if args.naming is not None and ending not in _EXPORTED:
        args.wrong_usage("argument --naming: a .blend keeps the character's own names")
    check_blender(args.blender)
    arguments = [args.motion, args.out]
    for name in ("to", "skeleton", "map", "render", "frame", "naming"):
        value = getattr(args, name)
        if value is not None:
            arguments += [f"--{name}", str(value)]
    arguments += ["--root-motion", args.root_motion.replace("-", "_")]
    progress(0.0, "retargeting")
    summary = run_blender(arguments, args.blender)
    if args.render is not None:
        summary["picture"] = str(Path(args.render))
    return summary


def run_blender(arguments: Sequence[str], blender: str | None = None, entry: str = _RETARGET) -> dict[str, Any]:
    """Run a module of the add-on in a process of its own; return its report, or raise."""
    done = subprocess.run(_command(blender, entry, arguments), capture_output=True, text=True, check=False)
    prefix = f"{entry.partition(':')[0].rpartition('.')[2]}: "
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()] or ["it ended without a message"]
        said = next((line for line in lines if line.startswith(prefix)), lines[-1])
        raise CharacterError(said.removeprefix(prefix))
    # Blender has lines of its own
    report: dict[str, Any] = json.loads([line for line in done.stdout.splitlines() if line.startswith("{")][-1])
    return report


def check_blender(blender: str | None) -> None:
    """Raise CharacterError when the Blender named, or else bpy, is missing."""
    blender = _chosen_blender(blender)
    if blender is None and importlib.util.find_spec("bpy") is None:
        raise CharacterError(
            "Blender's Python module is not here", advice="pip install bpy, of the same Python, or name a --blender"
        )
    if blender is not None and not is_file(blender):
        raise CharacterError("is no program", where=blender, advice="name the file of Blender's program")


def _chosen_blender(blender: str | None) -> str | None:
    return blender or os.environ.get(BLENDER_VARIABLE) or None


def _command(blender: str | None, entry: str, arguments: Sequence[str]) -> list[str]:
    blender = _chosen_blender(blender)
    if blender is None:
        package = (__package__ or "").rpartition(".core.")[0]
        return [sys.executable, "-m", entry.partition(":")[0].replace("perfanim", package, 1), *arguments]
    order = helper_process.order(entry, arguments)
    options = ("--background", "--factory-startup", "--disable-autoexec", "--python-exit-code", "1")
    return [blender, *options, "--python", helper_process.SCRIPT, "--", order]
