"""`perfanim retarget`: retarget a motion to a character."""

import argparse
from pathlib import Path
from typing import Any

from ..api.retargeting import EXPORTED, RetargetRequest, retarget
from ..retarget.retargeter import RootMotion
from ..system.progress import Progress
from .options import add_character_options, add_command, add_request_options, add_text, request_of


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "retarget", run, "retarget a motion to a character (needs bpy or Blender)")
    parser.add_argument("motion", metavar="MOTION", help="motion: .bvh or .amc")
    add_character_options(parser)
    add_request_options(
        parser,
        RetargetRequest,
        character="--to CHARACTER",
        skeleton="--skeleton FILE.asf",
        picture="--render FILE.png",
        frame="--frame N",
        naming="--naming",
    )
    written = f"file to write: a scene (.blend), or the character for other programs ({', '.join(EXPORTED)})"
    add_text(parser, "--out", "FILE.blend", written, required=True)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if args.naming is not None and Path(args.out).suffix.lower() not in EXPORTED:
        args.wrong_usage("argument --naming: a .blend keeps the character's own names")
    root_motion = RootMotion[args.root_motion.replace("-", "_").upper()]
    request = request_of(RetargetRequest, args, bone_map=args.map, root_motion=root_motion)
    progress(0.0, "retargeting")
    report = retarget(args.motion, args.out, request)
    return report if request.picture is None else report | {"picture": str(Path(request.picture))}
