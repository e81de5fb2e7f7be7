"""`perfanim bench`: the paper's tables and figures, and ours, on real data."""

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from perfanim.core.errors import SettingsError
from perfanim.core.system.progress import Progress

from .run import Run
from .scenarios import PARTS


class _Bench(NamedTuple):
    """A benchmark: what it measures, what --data must contain ("" for nothing), and its own options (`--name`)."""

    text: str
    data: str = "folder that holds cmu/ and bandai/"
    options: tuple[str, ...] = ()


_BENCHES = {
    "vision": _Bench("centres and points against the truth of the simulated cameras", ""),
    "table1": _Bench("frames that the search visits, and its error"),
    "figure5": _Bench("error of pose models by their dimension"),
    "end-to-end": _Bench("recorded motion filmed by simulated cameras and solved, compared with true markers"),
    "figure6": _Bench("nearest, lwr, local-pca and best frame by frame"),
    "accuracy": _Bench(
        "live and offline compared with other methods: unseen clips, people, kinds of motion and studios",
        options=("quick", "baseline"),
    ),
    "robustness": _Bench(
        "cuts, a T pose before takes, noise and unseen subjects; worst frames", options=("full", "only", "seed")
    ),
    "suits": _Bench(
        "recorded suits solved with nine of their markers: distance of the others; simulated keypoints",
        options=("suits", "baseline"),
    ),
    "marker-takes": _Bench(
        "every marker take of a folder, solved without any settings: suit, coverage, fit, verdict, picture",
        "folder of c3d/ and trc/",
        ("frames", "only-takes"),
    ),
    "unknown-labels": _Bench(
        "suits whose labels, or those of the arms, are drawn at random: labels, bones, wrists, distances, verdict",
        options=("suits", "seed", "frames", "only-takes"),
    ),
    "label-faults": _Bench(
        "label faults put into takes at random: how many are found, limbs when solved, false alarms", options=("seed",)
    ),
    "published": _Bench("trials and measures of published work on sparse inputs", options=("momentum", "suits")),
    "sketch": _Bench("bodies solved from the keys of eight takes, with five and with three controls"),
    "joint-angles": _Bench("joint angles of the embedded motion compared with those of people"),
    "speed": _Bench("time for detection, from two streams to labelled points, for solving and for the import"),
    "scale": _Bench("time to open, search and solve, and the error, by the size of the database", options=("full",)),
    "start": _Bench("time to the first pose, and to the next after its solver dies; memory", "", ("runs", "database")),
    "latency": _Bench(
        "time from images in hand to the bones, stage by stage; needs bpy",
        "",
        ("seconds", "tick-ms", "fps", "database"),
    ),
    "people": _Bench(
        "a person followed by two cameras: joints, time to poses", "films cam01.mp4 ..., and Calib.qca.txt"
    ),
    "simulated-people": _Bench(
        "people with a network's errors in films of two cameras: errors, feet, exchanged limbs, live and offline"
    ),
    "rendered-person": _Bench("a person rendered in a lit room, from two films to joints; needs bpy"),
    "retarget": _Bench("a walk and boxing on all characters of a folder; needs bpy", "folder of characters"),
    "setup-check": _Bench("faults that the check before a capture finds in random studios", "", ("studios", "seed")),
}
_OPTIONS: dict[str, dict[str, Any]] = {
    "quick": {"action": "store_true", "help": "fewer methods, frames and disturbances: takes a quarter of an hour"},
    "full": {"action": "store_true", "help": "the largest sizes, for hours (robustness) or with 5 GB of disk (scale)"},
    "only": {"nargs": "+", "choices": PARTS, "metavar": "PART", "help": "one or more of " + ", ".join(PARTS)},
    "frames": {
        "type": int,
        "metavar": "N",
        "help": "solve up to N frames, from the middle of each take (default: all)",
    },
    "only-takes": {"nargs": "+", "metavar": "TEXT", "help": "only takes with one of these texts in their path"},
    "seed": {"type": int, "metavar": "N", "help": "seed for everything that is random"},
    "suits": {"type": Path, "metavar": "DIR", "help": "folder that holds c3d/ and trc/ (default: that of --data)"},
    "momentum": {"type": Path, "metavar": "PYTHON", "help": "a Python with pymomentum-cpu, to solve full suits, too"},
    "baseline": {"type": Path, "metavar": "CHECKOUT", "help": "another version's folder, which solves the same takes"},
    "runs": {"type": int, "metavar": "N", "help": "captures with each database (default 10)"},
    "database": {"type": Path, "metavar": "FILE", "help": "database to solve with (default: the embedded motion)"},
    "seconds": {"type": float, "metavar": "S", "help": "measured duration of the capture (default 20)"},
    "tick-ms": {"type": float, "metavar": "MS", "help": "interval of Blender's timer (default: the product's)"},
    "fps": {"type": float, "metavar": "HZ", "help": "images per camera and second (default 60)"},
    "studios": {"type": int, "metavar": "N", "help": "studios of each kind (default 12)"},
}


def add_parser(subparsers: Any) -> None:
    """Add the command group."""
    group = subparsers.add_parser("bench", help="the tables and figures of the paper on real data")
    commands = group.add_subparsers(metavar="WHAT", required=True)
    for name, bench in _BENCHES.items():
        parser = commands.add_parser(name, help=bench.text)
        path: dict[str, Any] = {"type": Path, "metavar": "DIR"}
        parser.add_argument("--data", **path, required=bool(bench.data), help=bench.data or "not used")
        parser.add_argument("--out", **path, required=True, help="folder to write to; databases are kept there")
        parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes that read (default 2)")
        for option in bench.options:
            parser.add_argument(f"--{option}", **_OPTIONS[option])
        parser.set_defaults(run=_run, bench=name)


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    names = [option.replace("-", "_") for option in _BENCHES[args.bench].options]
    given = {name: value for name in names if (value := getattr(args, name)) not in (None, False)}
    if args.workers < 1:
        raise SettingsError(f"--workers {args.workers} is out of range", advice="give 1 or more")
    if given.get("seed", 0) < 0:
        raise SettingsError(f"--seed {args.seed} is out of range", advice="give 0 or more")
    name = args.bench.replace("-", "_")
    bench = getattr(import_module(f".{name}", __package__), name)
    figures: dict[str, Any] = bench(Run(args.data, args.out, args.workers, progress), **given)
    return figures
