"""`perfanim demo`: run the whole chain on a simulated performer."""

import argparse
import importlib.util
import json
from pathlib import Path
from typing import Any

from ..api.retargeting import RetargetRequest, retarget
from ..system.files import atomic_path
from ..system.progress import Progress
from .command_summary import jsonable
from .options import add_command, add_number, add_text, check_range


def add_parser(subparsers: Any) -> None:
    about = "run the whole chain on a simulated performer: cameras, tracking, solving, retargeting"
    parser = add_command(subparsers, "demo", run, about)
    add_text(parser, "--out", "DIR", "folder for the results (default out/demo)", default="out/demo")
    add_number(parser, "--seconds", "S", "length of the performance (default 21)", default=21.0)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Run the demo; write the report and, if bpy is installed, the character."""
    from ..simulate.run_demo import run_demo, write_report  # OpenCV is slow to load

    check_range("--seconds", args.seconds, 5.0, 600.0, "give 5 to 600")
    out = Path(args.out)
    report = run_demo(out, args.seconds, progress)
    if importlib.util.find_spec("bpy") is not None:
        progress(0.97, "writing the character")
        report["outputs"]["blend"] = retarget(out / "demo.bvh", out / "demo.blend", RetargetRequest())["out"]
    write_report(out / "report.md", report)
    with atomic_path(out / "report.json") as temporary:
        temporary.write_text(json.dumps(jsonable(report), indent=1), encoding="utf-8")
    report["outputs"]["report"] = str(out / "report.md")
    return report
