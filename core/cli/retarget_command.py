"""`perfanim retarget`: a motion onto a character."""

import argparse
from pathlib import Path
from typing import Any

from ..api.retargeting import EXPORTED, RetargetRequest, retarget
from ..retarget.joint_naming import NAMINGS
from ..retarget.retargeter import RootMotion
from ..system.progress import Progress
from .options import add_character_options, add_choice, add_command, add_text


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "retarget", run, "a motion onto a character (needs bpy or Blender)")
    parser.add_argument("motion", metavar="MOTION", help="motion: .bvh or .amc")
    add_text(parser, "--to", "CHARACTER", "humanoid of a .blend, .glb, .gltf, .vrm or .fbx file", required=True)
    add_character_options(parser)
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of an .amc motion")
    add_text(parser, "--render", "FILE.png", "also render a picture")
    add_text(parser, "--frame", "N", "frame of the picture, from 1 (default: the middle one)", type=int)
    names = "names of the bones in a file for other programs (default: the character's own)"
    add_choice(parser, "--naming", NAMINGS, names)
    written = f"file to write: a scene (.blend), or the character for other programs ({', '.join(EXPORTED)})"
    add_text(parser, "--out", "FILE.blend", written, required=True)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if args.naming is not None and Path(args.out).suffix.lower() not in EXPORTED:
        args.wrong_usage("argument --naming: a .blend keeps the character's own names")
    request = RetargetRequest(
        character=args.to,
        bone_map=args.map,
        root_motion=RootMotion[args.root_motion.replace("-", "_").upper()],
        skeleton=args.skeleton,
        naming=args.naming,
        picture=args.render,
        frame=args.frame,
        blender=args.blender,
    )
    progress(0.0, "retargeting")
    report = retarget(args.motion, args.out, request)
    return report if args.render is None else report | {"picture": str(Path(args.render))}
