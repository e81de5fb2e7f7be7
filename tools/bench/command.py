"""`perfanim bench`: the paper's tables and figures and ours, on real data."""

import argparse
from pathlib import Path
from typing import Any

from perfanim.core.errors import SettingsError
from perfanim.core.system.progress import Progress

from .accuracy import accuracy
from .end_to_end import end_to_end
from .figure5 import figure5
from .figure6 import figure6
from .joint_angles import joint_angle_distributions
from .robustness import FULL, PARTS, SEED, robustness
from .scale import scale
from .sketch import sketch
from .speed import speed
from .suits import suits
from .table1 import table1
from .vision import vision

_BENCHES = {
    "vision": (vision, "centres, points and labels against the truth of the simulated cameras"),
    "table1": (table1, "frames that the search visits, and its error"),
    "figure5": (figure5, "error of models of pose by their dimension"),
    "end-to-end": (end_to_end, "recorded motion filmed by simulated cameras, tracked and solved, beside true markers"),
    "figure6": (figure6, "nearest, lwr, local-pca and best frame by frame"),
    "accuracy": (accuracy, "live and offline beside other methods: unseen clips, people, kinds of motion and studios"),
    "robustness": (robustness, "cuts between takes, a T pose before takes, noise and unseen subjects; worst frames"),
    "suits": (suits, "recorded suits solved with nine of their markers: distance of the others"),
    "sketch": (sketch, "a body from keys of eight takes, with five and with three controls"),
    "joint-angles": (joint_angle_distributions, "joint angles of the embedded motion beside those of people, by kind"),
    "speed": (speed, "time of detection, of two streams to labelled points, of solve, search and import"),
    "scale": (scale, "time to open, search and solve, and the error, by the size of the database"),
}


def add_parser(subparsers: Any) -> None:
    """Add the command group."""
    group = subparsers.add_parser("bench", help="the tables and figures of the paper on real data")
    commands = group.add_subparsers(metavar="WHAT", required=True)
    for name, (bench, text) in _BENCHES.items():
        parser = commands.add_parser(name, help=text)
        parser.add_argument(
            "--data", type=Path, required=bench is not vision, metavar="DIR", help="folder that holds cmu/ and bandai/"
        )
        parser.add_argument(
            "--out", type=Path, required=True, metavar="DIR", help="folder to write to; databases are kept there"
        )
        parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes that read (default 2)")
        if bench is robustness:
            parser.add_argument("--full", action="store_true", help="500 cuts and 100,000 frames, which takes hours")
            parser.add_argument(
                "--only", nargs="+", choices=PARTS, metavar="PART", help="one or more of " + ", ".join(PARTS)
            )
            parser.add_argument("--seed", type=int, default=SEED, metavar="N", help=f"of chance (default {SEED})")
        if bench is scale:
            parser.add_argument(
                "--full", action="store_true", help="10 million frames, too: a quarter of an hour, 5 GB of disk"
            )
        if bench is accuracy:
            parser.add_argument(
                "--quick", action="store_true", help="fewer methods, frames and disturbances, a quarter of an hour"
            )
        if bench is suits:
            parser.add_argument(
                "--suits", type=Path, metavar="DIR", help="folder that holds c3d/ and trc/ (default: that of --data)"
            )
        if bench in (accuracy, suits):
            parser.add_argument(
                "--baseline",
                type=Path,
                metavar="CHECKOUT",
                help="another version's folder, which solves the same takes",
            )
        parser.set_defaults(run=_run, bench=bench)


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if args.workers < 1:
        raise SettingsError(f"--workers {args.workers} is out of range", advice="give 1 or more")
    more: dict[str, Any] = {}
    if getattr(args, "full", False):
        more = {"sizes": FULL} if args.bench is robustness else {"full": True}
    if args.bench is robustness:
        if args.seed < 0:
            raise SettingsError(f"--seed {args.seed} is out of range", advice="give 0 or more")
        more |= {"parts": tuple(dict.fromkeys(args.only or PARTS)), "seed": args.seed}
    if getattr(args, "quick", False):
        more["quick"] = True
    if getattr(args, "baseline", None):
        more["checkout"] = args.baseline
    if getattr(args, "suits", None):
        more["suits_data"] = args.suits
    return args.bench(args.data, args.out, args.workers, progress, **more)
