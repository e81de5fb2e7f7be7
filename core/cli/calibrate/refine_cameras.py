"""`perfanim calibrate refine`: correct the poses of bumped cameras with a take's markers."""

import argparse
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import CalibrationError
from ...geometry.rig_file import load_rig, save_rig
from ...system.progress import Progress
from ..options import add_command, add_source_options, add_text


def add_parser(group: Any) -> None:
    about = "find out whether a camera was bumped, and where it is now, from any moving markers"
    parser = add_command(group, "refine", run, about)
    source = "a video, or a folder or pattern of images, in which one or more markers move through the capture space"
    add_source_options(parser, source)
    add_text(parser, "--out", "refined.toml", "the calibration to write", required=True)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ...vision.calibration.rig_refinement import refine_rig

    rig = load_rig(args.cameras)
    frames = _detected(args, rig, progress)
    progress(0.8, "placing the cameras")
    result = refine_rig(rig, frames)
    names = [camera.name for camera in rig.cameras]
    moved = names[int(np.argmax(result.turned_deg))]
    if result.bumped and not result.sure:
        raise CalibrationError(
            f"{moved} has moved relative to {names[0]}, and the markers determine its new position only to within "
            f"{100.0 * result.depth_sigma:.1f} % of their distance",
            where=str(args.cameras),
            advice="calibrate again with the board",
        )
    advice = []
    if result.bumped:
        advice = [f"{moved} has moved relative to {names[0]}: use the refined calibration, or calibrate again"]
    elif not result.sure:
        advice = [
            "the cameras are where they were calibrated; the markers do not locate them better, so nothing was changed"
        ]
    save_rig(replace(rig, cameras=result.rig.cameras) if result.sure else rig, args.out)
    return {
        "bumped": result.bumped,
        "before_px": result.before_px,
        "after_px": result.after_px,
        "turned_deg": dict(zip(names, result.turned_deg.tolist(), strict=True)),
        "moved_mm": dict(zip(names, result.moved_mm.tolist(), strict=True)),
        "depth_sigma_percent": 100.0 * result.depth_sigma,
        "changed": result.sure,
        "points": result.points,
        "advice": advice,
        "out": str(args.out),
    }


def _detected(args: argparse.Namespace, rig: Any, progress: Progress) -> list[list[Any]]:
    """Return the blobs of each camera in up to 300 frames spread over the take."""
    from ...api.tracking import learn_from_source  # OpenCV is slow to load
    from ...vision.pipeline import MarkerPipeline
    from ...vision.sources.source_kinds import open_image_source

    most, frames = 300, []
    with closing(open_image_source(args.left, args.right, *args.camera)) as source:
        pipeline = MarkerPipeline(rig)
        progress(0.0, "learning the background")
        learn_from_source(pipeline, source)
        for number, images in enumerate(source.samples(most)):
            sizes = [(image.shape[1], image.shape[0]) for image in images]
            expected = [camera.image_size for camera in rig.cameras]
            if sizes != expected:
                shown, known = (", ".join(f"{w} x {h}" for w, h in each) for each in (sizes, expected))
                advice = "use the calibration of these cameras at this resolution"
                what = f"the images have {shown} pixels, but the calibration is for {known}"
                raise CalibrationError(what, advice=advice)
            progress(0.8 * number / most, f"looking for markers: frame {number + 1}")
            frames.append([d.detect(image) for d, image in zip(pipeline.detectors, images, strict=True)])
    return frames
