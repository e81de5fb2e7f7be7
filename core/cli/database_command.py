"""`perfanim database build`, `get` and `info`."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..body.standard_skeleton import JOINT_NAMES
from ..database.build_database import BuildSettings, build_database
from ..database.culling import SETTINGS
from ..database.public_collections import get_collection, public_collections
from ..database.reference_poses import reference_pose_report
from ..database.store import open_database
from ..errors import SettingsError
from ..system.progress import Progress
from .options import (
    add_command,
    add_group,
    add_number,
    add_repeated,
    add_switch,
    add_text,
    check_fps,
    check_range,
)


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "database", "build, get or inspect a motion database")
    build = add_command(group, "build", _build, "build a database from motion files")
    build.add_argument("sources", nargs="+", metavar="SRC", help="BVH or AMC file, folder, .zip or .tar archive")
    _add_build_options(build, out_required=True)
    get = add_command(group, "get", _get, "download a public motion collection, and build a database from it")
    listed = "name of a listed collection, or the URL of an archive (default: print the list)"
    get.add_argument("collection", nargs="?", metavar="NAME|URL", help=listed)
    add_text(get, "--to", "DIR", "folder for archives (default: the current one)", type=Path, default=Path())
    _add_build_options(get, out_required=False)
    info = add_command(group, "info", _info, "contents of a database")
    info.add_argument("database", metavar="DB")


def _add_build_options(parser: Any, out_required: bool) -> None:
    add_text(parser, "--out", "DB", "database file to write", required=out_required)
    parser.add_argument("--fps", type=float, default=60.0, help="frames per second stored (default 60)")
    add_repeated(parser, "--include", "GLOB", "use only files of this name or behaviour; repeatable")
    add_repeated(parser, "--exclude", "GLOB", "leave out files of this name or behaviour; repeatable")
    add_switch(parser, "--mirror", "add the mirror image of every clip")
    usual = SETTINGS.distance_deg
    cull = (
        "leave out passages that differ from an earlier clip by at most DEG degrees, RMS over the joint angles "
        f"({usual:g} if given without a number; default: keep all)"
    )
    add_number(parser, "--cull", "DEG", cull, nargs="?", const=usual, default=0.0)
    add_text(parser, "--workers", "N", "processes that read files (default: one per core if that is faster)", type=int)


def _build(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    _check_build_options(args)
    return _built(args, args.sources, progress)


def _get(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    _check_build_options(args)  # fail before hours of work
    if args.collection is None:
        if args.out is not None:
            raise SettingsError("--out needs a collection", advice=f"give one of {', '.join(public_collections())}")
        return {"collections": [asdict(each) for each in public_collections().values()]}
    share = 1.0 if args.out is None else 0.5
    archive = get_collection(args.collection, args.to, lambda fraction, text: progress(share * fraction, text))
    summary = {"archive": str(archive), "bytes": archive.stat().st_size}
    if args.out is None:
        return summary
    later = _built(args, [str(archive)], lambda fraction, text: progress(0.5 + 0.5 * fraction, text))
    return summary | later


def _check_build_options(args: argparse.Namespace) -> None:
    check_fps(args.fps)
    check_range("--workers", args.workers, 1, math.inf, "give 1 or more")
    check_range("--cull", args.cull, 0.0, 20.0, "give 0 to 20 degrees")


def _built(args: argparse.Namespace, sources: Sequence[str], progress: Progress) -> dict[str, Any]:
    settings = BuildSettings(args.fps, args.include, args.exclude, args.mirror, args.cull, args.workers)
    return build_database(sources, args.out, settings, progress)


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
        "zeros": reference_pose_report(database),
    }
