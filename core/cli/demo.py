"""`perfanim demo`: the main job on the embedded default."""

import argparse
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from ..errors import CharacterError
from ..system.files import atomic_path
from ..system.progress import Progress
from .main import jsonable
from .options import check_range


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "demo", help="the whole chain on the embedded default: performer, cameras, tracking, solve, character"
    )
    parser.add_argument("--out", default="out/demo", metavar="DIR", help="folder for the results (default out/demo)")
    parser.add_argument("--seconds", type=float, default=21.0, metavar="S", help="of performance (default 21)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Run the demo, write the character where Blender is at hand, and the report."""
    from ..simulate.demo import run_demo, write_report  # images and plots load only for the command that needs them

    check_range("--seconds", args.seconds, 5.0, 600.0, "give 5 to 600")
    out = Path(args.out)
    report = run_demo(out, args.seconds, progress)
    if importlib.util.find_spec("bpy") is not None:
        report["outputs"]["blend"] = str(_write_blend(out, progress))
    write_report(out / "report.md", report)
    with atomic_path(out / "report.json") as temporary:
        temporary.write_text(json.dumps(jsonable(report), indent=1), encoding="utf-8")
    report["outputs"]["report"] = str(out / "report.md")
    return report


def _write_blend(out: Path, progress: Progress) -> Path:
    """Write the character with its animation, in a separate process.

    bpy takes over its process.
    """
    progress(0.97, "writing the character")
    target = out / "demo.blend"
    package = __package__.rsplit(".", 2)[0]
    module = f"{package}.perfanim_addon.export.export_blend"
    command = [sys.executable, "-m", module, str(out / "demo.bvh"), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise CharacterError(f"Blender could not write the character: {reason}", where=str(target))
    return target
