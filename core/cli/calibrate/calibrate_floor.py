"""`perfanim calibrate floor`: set floor, origin and scale from markers on the floor."""

import argparse
from contextlib import closing
from typing import Any

from ...errors import CalibrationError
from ...geometry.rig_file import load_rig, save_rig
from ...system.progress import Progress
from ..options import add_command, add_number, add_source_options, add_text


def add_parser(group: Any) -> None:
    parser = add_command(group, "floor", run, "floor, origin and scale from three or more markers lying on the floor")
    add_source_options(parser, "a video, or a folder or pattern of images, in which the markers lie still for a second")
    dark = "the same view without the markers, one source per camera (default: everything else is assumed to be dark)"
    add_text(parser, "--background", "SRC", dark, nargs="+")
    add_number(parser, "--threshold", "LEVELS", "grey levels above the background (default: automatic)")
    height = "height of the marker centres above the floor, such as a ball's radius (default 0)"
    add_number(parser, "--height-mm", "MM", height, default=0.0)
    longest = "measured distance between the two markers farthest apart: sets the scale (default: the scale is kept)"
    add_number(parser, "--longest-mm", "MM", longest)
    add_text(parser, "--out", "level.toml", "the calibration to write", required=True)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ...vision.calibration.floor_watch import scaled_to
    from ...vision.calibration.rig_on_floor import rig_on_floor

    rig = load_rig(args.cameras)
    watch = _watch(args, rig, progress)
    if watch.points_m is None:
        raise CalibrationError(
            "no markers lie still on the floor for a second", where=str(args.left), advice=watch.advice
        )
    points_m, scale = watch.points_m, 1.0
    if args.longest_mm is not None:
        rig, points_m, scale = scaled_to(rig, points_m, 1e-3 * args.longest_mm)
    level = rig_on_floor(rig, points_m, above_m=1e-3 * args.height_mm)
    save_rig(level, args.out)
    return {"markers": len(points_m), "scale": scale, "camera_heights_mm": level.heights_mm, "out": str(args.out)}


def _watch(args: argparse.Namespace, rig: Any, progress: Progress) -> Any:
    from ...api.tracking import make_pipeline
    from ...vision.calibration.floor_watch import FloorWatch
    from ...vision.sources.source_kinds import open_image_source

    pipeline = make_pipeline(rig, args.threshold, args.background or (), progress)
    watch = FloorWatch()
    with closing(open_image_source(args.left, args.right, *args.camera)) as source:
        total = max(int(getattr(source, "frames", 0)), 1)
        for number, images in enumerate(source):
            progress(min(number / total, 1.0), f"looking for markers: frame {number + 1}")
            watch.see(images.times_s[0], pipeline.process(images).points_m)
            if watch.points_m is not None:
                break
    return watch
