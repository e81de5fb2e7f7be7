"""`perfanim calibrate cameras --by-walking`, `--by-marker` and `--by-stick`: calibrate cameras without a board."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...errors import SettingsError
from ...geometry.rig_file import load_rig, save_rig
from ...system.progress import Progress
from ..options import add_number, add_switch, add_text, check_height, check_range


def add_options_without_board(parser: Any) -> None:
    """Add the options for a calibration by a person, a marker or a stick."""
    person = "calibrate without a board, by a person who walks about for 20 s and is seen by all cameras"
    add_switch(parser, "--by-walking", person)
    add_switch(parser, "--by-marker", "calibrate without a board, by one marker waved through the room; needs --apart")
    stick = "calibrate without a board, by two markers on a stick, this many millimetres apart, waved through the room"
    add_number(parser, "--by-stick", "MM", stick)
    add_number(parser, "--height", "M", "with --by-walking: height of the person (default: of an average adult)")
    add_number(parser, "--apart", "M", "with --by-marker: measured distance between the first two cameras")
    lenses = "without a board: calibration whose lenses the cameras of the same names have (default: estimated)"
    add_text(parser, "--lenses", "cameras.toml", lenses)
    add_text(
        parser, "--network", "FILE", "with --by-walking: body network (default: the one of `network get`)", type=Path
    )


def wants_no_board(args: argparse.Namespace) -> bool:
    """Return whether a calibration without a board is asked for."""
    return bool(args.by_walking or args.by_marker or args.by_stick is not None)


def calibrate_without_board(args: argparse.Namespace, sources: Mapping[str, str], progress: Progress) -> dict[str, Any]:
    """Calibrate, write the calibration, and return its summary."""
    from ...api.moving_calibration import calibrate_by_marker, calibrate_by_walking  # OpenCV is slow to load

    _check(args)
    lenses = load_rig(args.lenses) if args.lenses else None
    if args.by_walking:
        found = calibrate_by_walking(sources, args.height, lenses, args.network, progress)
    else:
        stick_m = 1e-3 * (args.by_stick or 0.0)
        found = calibrate_by_marker(
            sources, stick_m=stick_m, apart_m=args.apart or 0.0, lenses=lenses, progress=progress
        )
    save_rig(found.result.rig, args.out)
    return {**found.summary(), "out": str(args.out)}


def _check(args: argparse.Namespace) -> None:
    ways = {"--by-walking": args.by_walking, "--by-marker": args.by_marker, "--by-stick": args.by_stick is not None}
    given = [name for name, is_given in ways.items() if is_given]
    for option, way in (("board", None), ("points", None), ("height", "--by-walking"), ("network", "--by-walking"),
                        ("apart", "--by-marker")):  # fmt: skip
        if getattr(args, option) is not None and way != given[0]:
            raise SettingsError(f"--{option} is not for {given[0]}", advice="leave one of them out")
    if len(given) > 1:
        raise SettingsError(f"{given[0]} and {given[1]} exclude each other", advice="choose one")
    if args.by_marker and args.apart is None:
        raise SettingsError("--by-marker needs --apart", advice="measure the distance between the first two cameras")
    check_height(args.height)
    check_range("--apart", args.apart, 0.05, 100.0, "give metres, 0.05 to 100")
    check_range("--by-stick", args.by_stick, 20.0, 5000.0, "give millimetres, 20 to 5000")
