"""`perfanim database build` and `perfanim database info`."""

import argparse
import math
from typing import Any

from ..body.standard_skeleton import JOINT_NAMES
from ..database.build import BuildSettings, build_database
from ..database.culling import DEFAULT_CULL_DEG
from ..database.store import open_database
from ..database.zeros import zeros_report
from ..system.progress import Progress
from .options import add_repeated, add_switch, add_text, check_fps, check_range


def add_parser(subparsers: Any) -> None:
    group = subparsers.add_parser("database", help="build or inspect a motion database")
    commands = group.add_subparsers(metavar="COMMAND", required=True)
    build = commands.add_parser("build", help="motion files to a database")
    build.add_argument("sources", nargs="+", metavar="SRC", help="BVH or AMC file, folder, .zip or .tar archive")
    add_text(build, "--out", "DB", "database file to write", required=True)
    build.add_argument("--fps", type=float, default=60.0, help="frames per second stored (default 60)")
    add_repeated(build, "--include", "GLOB", "take only files of this name or behaviour; repeatable")
    add_repeated(build, "--exclude", "GLOB", "leave out files of this name or behaviour; repeatable")
    add_switch(build, "--mirror", "add the mirror image of every clip")
    build.add_argument(
        "--cull",
        type=float,
        nargs="?",
        const=DEFAULT_CULL_DEG,
        default=0.0,
        metavar="DEG",
        help="leave out passages that an earlier clip holds within DEG degrees, root mean square over the joint "
        f"angles (default {DEFAULT_CULL_DEG:g} when given without a number; else none are)",
    )
    add_text(build, "--workers", "N", "processes that read (default: one a core where it is worth it)", type=int)
    build.set_defaults(run=_build)
    info = commands.add_parser("info", help="contents of a database")
    info.add_argument("database", metavar="DB")
    info.set_defaults(run=_info)


def _build(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_fps(args.fps)
    check_range("--workers", args.workers, 1, math.inf, "give 1 or more")
    check_range("--cull", args.cull, 0.0, 20.0, "give 0 to 20 degrees")
    return build_database(
        args.sources,
        args.out,
        BuildSettings(
            fps=args.fps,
            include=args.include,
            exclude=args.exclude,
            mirror=args.mirror,
            cull_deg=args.cull,
            workers=args.workers,
        ),
        progress=progress,
    )


def _info(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    database = open_database(args.database)
    return {
        "frames": database.frames,
        "clips": len(database.clips),
        "fps": database.fps,
        "minutes": round(database.frames / database.fps / 60.0, 2),
        "joints": list(JOINT_NAMES),
        "behaviours": database.behaviours,
        "subjects": sorted({clip.subject for clip in database.clips}),
        "skeletons": len(database.skeletons),
        "source_fps": database.source_rates,
        "mirrored_clips": sum(clip.mirrored for clip in database.clips),
        "culled_frames": database.culled_frames,
        "zeros": zeros_report(database),
    }
