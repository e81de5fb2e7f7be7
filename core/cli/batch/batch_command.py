"""`perfanim batch`: track, solve, retarget and rate many takes."""

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...body.foot_lock import FEET
from ...database.store import open_database
from ...errors import FormatError, PerfanimError, SettingsError
from ...formats.markers.marker_files import READABLE
from ...formats.motion.read_motion import read_skeleton
from ...geometry.rig_file import load_rig
from ...labelling.take_import import UPS
from ...markers.label_matching import AUTO, load_names
from ...markers.marker_set import load_marker_set
from ...markers.subject import load_subject
from ...solver.settings import METHODS
from ...system.blender_process import check_blender
from ...system.files import is_file
from ...system.progress import Progress
from ..command_summary import PartialResult
from ..options import (
    add_character_options,
    add_choice,
    add_motion_options,
    add_number,
    add_text,
    check_range,
)
from ..performer_options import add_names_option
from . import take_server
from .plan import ALSO, OPTIONS, SAVED_AS, Plan, TakePlan, Value, plan_of, read_plan
from .processes import in_processes
from .run_batch import BatchResult, DoTasks, run_batch
from .summary import counts, facts, text_table
from .take_record import BAD

_CHECKS: dict[str, Callable[[str], object]] = {
    "database": open_database,
    "subject": load_subject,
    "skeleton": read_skeleton,
    "names": load_names,
    "marker_set": lambda name: name == AUTO or load_marker_set(name),
    "cameras": load_rig,
}


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "batch",
        help="solve, retarget and rate many takes; continues where it stopped",
        description="Solve many takes in parallel. Finished takes are skipped, and a bad take does not stop the "
        "others. The exit status is 1 if any take is bad.",
    )
    parser.add_argument(
        "takes",
        nargs="+",
        metavar="PLAN.toml | TAKES",
        help=f"a plan file; or takes ({', '.join(READABLE)}), folders of takes, or patterns",
    )
    add_text(parser, "--out", "DIR", "folder for the results (default: the plan's out)")
    shared = parser.add_argument_group("for all takes; a plan's [[take]] tables take precedence")
    add_text(shared, "--database", "DB", "motion database")
    add_text(shared, "--subject", "FILE", "calibrated subject")
    add_text(shared, "--skeleton", "FILE", ".asf or .bvh with the bones to use; needs --marker-set")
    add_text(shared, "--marker-set", "NAME", f"shipped marker set or TOML file, or {AUTO} (marker files only)")
    add_names_option(shared)
    add_text(shared, "--use", "N|NAME,...", "solve marker takes with only some of a suit's markers")
    add_choice(shared, "--up", UPS, "axis of marker files that points up (default: auto)")
    add_choice(shared, "--method", METHODS, "solver method (default best)")
    add_number(shared, "--smooth", "HZ", "low-pass filter the markers before solving and the motion after it")
    add_choice(shared, "--feet", FEET, "hold feet in place (default off)")
    add_motion_options(shared, defaults=False)
    shared.add_argument(
        "--also", action="append", choices=ALSO, help="format of a further file to write beside each BVH; repeatable"
    )
    add_text(shared, "--cameras", "cameras.toml", "calibration of videos, or a different one for .perftakes")
    add_text(shared, "--to", "CHARACTER", "also retarget to this character: .blend, .glb, .gltf, .vrm or .fbx file")
    add_character_options(shared, root_motion=None)
    add_choice(shared, "--save-as", SAVED_AS, "format of the character files (default blend)")
    add_text(parser, "--jobs", "N", "number of processes (default: one per core)", type=int)
    add_text(
        parser,
        "--scheduler",
        "ADDRESS",
        "Dask scheduler whose cluster processes the takes (tcp://HOST:8786), see docs/batch.md",
    )
    parser.set_defaults(run=run, wrong_usage=parser.error)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_range("--jobs", args.jobs, 1, 1000, "give 1 to 1000")
    if args.jobs is not None and args.scheduler is not None:
        args.wrong_usage("argument --jobs: not allowed with --scheduler, whose workers determine the number")
    plan = _plan(args)
    out = args.out or plan.out
    if not out:
        args.wrong_usage("the following arguments are required: --out")
    progress(0.0, "checking the plan")
    _check(plan)
    result = run_batch(plan.takes, Path(out), _task_runner(args), progress)
    return _summary(result, out)


def _plan(args: argparse.Namespace) -> Plan:
    given: dict[str, Value] = {key: value for key in OPTIONS if (value := getattr(args, key, None)) is not None}
    if any(name.lower().endswith(".toml") for name in args.takes):
        if len(args.takes) > 1:
            args.wrong_usage("a plan must be the only argument: name further takes in it")
        return read_plan(args.takes[0], given)
    return plan_of(args.takes, given)


def _task_runner(args: argparse.Namespace) -> DoTasks:
    if args.scheduler is None:
        return partial(in_processes, take_server.serve, args.jobs or os.cpu_count() or 1)
    from .cluster import on_cluster  # Dask is slow to load, and not needed without a cluster

    return partial(on_cluster, args.scheduler, take_server.serve_task)


def _check(plan: Plan) -> None:
    """Raise for bad options and unusable files, before any work starts.

    The takes themselves are not read, because one bad take must not stop the others.
    """
    lines: set[str] = set()
    files: set[tuple[str, str]] = set()
    characters: set[tuple[str, str]] = set()
    for take in plan.takes:
        line = repr((take.options, take.is_tracked, Path(take.take).suffix.lower()))
        if line not in lines:
            lines.add(line)
            try:
                _check_options(take)
            except PerfanimError as error:
                raise SettingsError(f"{take.source}: {error}") from error
        files |= {(key, str(value)) for key, value in take.options.items() if key in _CHECKS}
        if "to" in take.options:
            characters.add((str(take.options["to"]), str(take.options.get("blender", ""))))
    for key, value in sorted(files):
        _CHECKS[key](value)
    for character, blender in sorted(characters):
        if not is_file(character):
            raise FormatError("cannot be read (no such file)", where=character, advice="check the path")
        check_blender(blender or None)


def _check_options(take: TakePlan) -> None:
    take_server.parse_options("solve", [take.take or "x.take.npz", *take.options_of("solve"), "--out", "x.bvh"])
    if take.is_tracked:
        line = [*take.options_of("track"), *take.options_of("label"), "--out", "x.take.npz"]
        take_server.parse_options("track", line)
    if take.options_of("retarget"):
        take_server.parse_options("retarget", ["x.bvh", *take.options_of("retarget"), "--out", "x.blend"])


def _summary(result: BatchResult, out: str) -> PartialResult:
    """Return the summary, with a table for people."""
    place = Path(out)
    rows = []
    for record in result.records:
        outputs = {kind: str(place / file) for kind, file in record.outputs.items()}
        before = record.name in result.finished_before
        rows.append(facts(replace(record, outputs=outputs)) | {"finished_before": before})
    counted = counts(result.records)
    page, done = str(place / result.page.name), len(result.finished_before)
    line = ", ".join(f"{count} {status}" for status, count in counted.items())
    failure = f"{out}: bad takes: {counted[BAD]} of {len(rows)}; see {page}" if counted[BAD] else ""
    text = f"{text_table(result.records)}\n\n{line}; {done} from an earlier run\n{page}"
    return PartialResult(counted | {"finished_before": done, "takes": rows, "page": page}, text, failure)
