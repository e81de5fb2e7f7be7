"""`perfanim sketch`: solve a whole body from a few keyframed trajectories."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..body.motion import with_lead_in
from ..body.skeleton import Skeleton
from ..database.starter_database import starter_database
from ..database.store import open_database
from ..errors import FormatError, PerfanimError
from ..formats.motion.read_motion import read_skeleton
from ..formats.motion.write_motion import MOTION_ENDINGS, is_motion, write_motion
from ..markers.subject import load_subject, skeleton_from
from ..sketch.sketch_file import LIMITS, Sketch, read_sketch
from ..sketch.sketch_messages import sketch_from
from ..sketch.solve_sketch import SketchSettings, SketchSolution, SketchSolver
from ..system.blender_process import check_blender, run_in_blender
from ..system.progress import Progress
from .command_summary import PartialResult
from .options import (
    add_command,
    add_motion_options,
    add_repeated,
    add_request_options,
    add_switch,
    add_text,
    request_of,
)
from .performer_options import add_body_options


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "sketch", run, "a whole body from a few keyframed trajectories")
    files = "sketches: control,frame,x,y,z in metres, y up; or .blend files with controls, which need bpy or Blender"
    parser.add_argument("keys", nargs="+", metavar="KEYS.csv", help=files)
    add_text(parser, "--database", "DB", "motion database that fills in the body (default: the starter database)")
    subject = "calibrated subject with the character's bones (a .blend has its own)"
    add_body_options(parser, subject, ".asf or .bvh with the character's bones")
    add_request_options(parser, SketchSettings, follow="--follow SHARE", variation="--variation N")
    add_repeated(parser, "--behaviour", "PATTERN", "draw only from clips of this behaviour or name (repeatable)")
    add_switch(parser, "--free-feet", "do not hold standing feet in place")
    ends = ", ".join(MOTION_ENDINGS)
    add_text(parser, "--blender", "FILE", "Blender executable that opens a .blend (default: the Python module bpy)")
    add_text(parser, "--out", "MOTION.bvh", f"motion to write ({ends}); for several sketches, a folder", required=True)
    add_motion_options(parser)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Solve the sketches; a bad one does not stop the others."""
    settings = request_of(SketchSettings, args, behaviours=tuple(args.behaviour), hold_feet=not args.free_feet)
    outs = _outputs([Path(path) for path in args.keys], Path(args.out))
    progress(0.0, "reading")
    has_skeleton, blends = bool(args.skeleton or args.subject), sum(_is_blend(keys) for keys, _ in outs)
    if not has_skeleton and blends < len(outs):
        args.wrong_usage("one of the arguments --subject --skeleton is required, except for .blend files")
    if blends:
        check_blender(args.blender)
    solver = None
    if has_skeleton:
        skeleton = read_skeleton(args.skeleton) if args.skeleton else load_subject(args.subject).skeleton
        solver = SketchSolver(skeleton, open_database(args.database or starter_database(progress)))
    if len(outs) == 1:
        return _solve(args, solver, settings, *outs[0], progress)
    rows = []
    for number, (keys, out) in enumerate(outs):
        progress(number / len(outs), keys.name)
        try:
            rows.append({"keys": str(keys)} | _solve(args, solver, settings, keys, out, lambda share, text: None))
        except PerfanimError as error:
            rows.append({"keys": str(keys), "error": str(error)})
    failed = [row for row in rows if "error" in row]
    text = "\n".join(f"{row['keys']}: {row.get('error') or row['out']}" for row in rows)
    failure = f"{len(failed)} of {len(rows)} sketches failed; {failed[0]['error']}" if failed else ""
    return PartialResult({"sketches": rows, "failed": len(failed)}, text, failure)


def _outputs(keys: list[Path], out: Path) -> list[tuple[Path, Path]]:
    """Return each sketch with the path of its output.

    Raises:
        FormatError: The output's extension is not that of a motion file, or two sketches would write the same file.
    """
    if len(keys) == 1:
        if not is_motion(out):
            raise FormatError(
                "does not have the extension of a motion file",
                where=str(out),
                advice=f"use one of {', '.join(MOTION_ENDINGS)}",
            )
        return [(keys[0], out)]
    if is_motion(out):
        raise FormatError("cannot hold several sketches", where=str(out), advice="give a folder with --out")
    pairs = [(path, out / f"{path.stem}.bvh") for path in keys]
    if len({path for _, path in pairs}) < len(pairs):
        raise FormatError("two sketches have the same name", where=str(out), advice="rename one of the files")
    return pairs


def _solve(
    args: argparse.Namespace,
    solver: SketchSolver | None,
    settings: SketchSettings,
    keys: Path,
    out: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Solve a sketch, write its motion and return its figures.

    Args:
        solver: Solver for the skeleton that the options name; None to use the bones in the .blend.
    """
    sketch, skeleton = _read_blend(keys, args.blender) if _is_blend(keys) else (read_sketch(keys), None)
    if solver is None and skeleton is not None:
        solver = SketchSolver(skeleton, open_database(args.database or starter_database(progress)))
    assert solver is not None  # noqa: S101 - a sketch without a skeleton comes with --skeleton or --subject
    solution = solver.solve(sketch, settings, progress)
    first = int(sketch.frames[0])
    # motion files count frames from 0: holding the first pose until then makes their frame numbers match the sketch's
    lead_in = first if 0 < first <= LIMITS.most_frames else 0
    written = write_motion(with_lead_in(solution.motion, lead_in), out, args.units, args.naming, args.rate)
    return _facts(solution) | {"first_frame": first, "held_frames": lead_in, "fps": written.fps, "out": str(out)}


def _is_blend(keys: Path) -> bool:
    return keys.suffix.lower() == ".blend"


def _read_blend(path: Path, blender: str | None) -> tuple[Sketch, Skeleton]:
    """Return the sketch and the bones of the only character with controls in a .blend."""
    found = run_in_blender("perfanim.perfanim_addon.sketch.read_blend:main", [str(path)], blender)
    return sketch_from(found["sketch"]), skeleton_from(found["skeleton"], str(path))


def _facts(solution: SketchSolution) -> dict[str, Any]:
    distances_mm = 1e3 * solution.key_distances_m
    unmet = [
        {"joint": key.joint, "frame": key.frame, "distance_mm": round(1e3 * key.distance_m, 1), "reason": key.reason}
        for key in solution.unmet
    ]
    return {
        "frames": solution.motion.frames,
        "keys": len(distances_mm),
        "keys_met_mm": float(np.max(distances_mm)),
        "keys_unmet": len(unmet),
        "unmet": unmet,
        "drawn_from": list(solution.drawn_from),
    }
