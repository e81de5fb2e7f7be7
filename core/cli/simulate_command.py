"""`perfanim simulate markers` and `cameras`: make takes and videos from motion, with ground truth."""

import argparse
import math
from pathlib import Path
from typing import Any

from ..body.motion import resampled
from ..formats.markers.marker_files import check_ending, write_take
from ..formats.motion.bvh import write_bvh
from ..formats.motion.read_motion import read_motion
from ..markers.marker_set import load_marker_set
from ..simulate.simulated_markers import simulate_markers
from ..simulate.studio.export_recording import RecordingFiles, export_recording
from ..simulate.studio.render import Renderer
from ..simulate.studio.simulated_source import simulated_source
from ..simulate.studio.stage_placement import on_stage, with_poses
from ..simulate.studio.studio_rig import FPS, default_rig
from ..simulate.studio.studio_settings import StudioSettings
from ..simulate.studio.video import LOSSLESS
from ..system.progress import Progress
from .options import add_choice, add_command, add_group, add_number, add_switch, add_text, check_fps, check_range, seed

_CODECS = {"huffyuv": LOSSLESS, "ffv1": (".mkv", "FFV1"), "mjpeg": (".avi", "MJPG"), "mpeg4": (".mp4", "mp4v")}


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "simulate", "marker takes and camera videos made from motion")
    markers = add_command(group, "markers", _simulate_markers, "marker take from motion, with ground truth")
    _add_motion(markers)
    add_text(markers, "--marker-set", "NAME", "shipped marker set or TOML file", required=True)
    add_text(markers, "--out", "TAKE", "take to write: .take.npz, .csv or .trc", required=True)
    add_number(markers, "--fps", "HZ", "rate of the take (default: the motion's)")
    add_number(markers, "--noise-mm", "S", "standard deviation per coordinate, mm (default 0)", default=0.0)
    add_number(markers, "--dropout", "P", "share of positions that are missing (default 0)", default=0.0)
    add_text(markers, "--seed", "N", "seed of noise and gaps (default 0)", type=seed, default=0)
    about = "videos of two or more cameras and pictures of the board, with ground truth, from motion"
    cameras = add_command(group, "cameras", _simulate_cameras, about)
    _add_motion(cameras)
    add_text(cameras, "--out", "DIR", "new folder for all files", required=True)
    add_text(cameras, "--marker-set", "NAME", "shipped marker set or TOML file (default boxing)", default="boxing")
    add_text(cameras, "--cameras", "N", "how many cameras (default 2)", type=int, default=2)
    add_number(cameras, "--fps", "HZ", "images per second (default 60)", default=FPS)
    add_number(cameras, "--t-pose", "S", "T pose before the motion, seconds (default 2; 0: none)", default=2.0)
    add_switch(cameras, "--as-recorded", "leave the motion where it is instead of bringing it in front of the cameras")
    _add_studio_options(cameras)
    add_text(
        cameras, "--background", "N", "number of images of the empty capture space (default 60)", type=int, default=60
    )
    add_text(cameras, "--board-views", "N", "number of board poses (default 24)", type=int, default=24)
    codec = "huffyuv (default) and ffv1 are lossless; the others make smaller files"
    add_choice(cameras, "--codec", sorted(_CODECS), codec, default="huffyuv")


def _add_motion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of an AMC file")


def _add_studio_options(parser: argparse.ArgumentParser) -> None:
    default = StudioSettings()
    add_number(parser, "--noise", "S", "sensor noise, grey levels (default 2)", default=default.noise_sigma)
    add_number(
        parser, "--marker-radius-mm", "R", "radius of the markers (default 12.5)", default=1e3 * default.marker_radius_m
    )
    add_number(parser, "--exposure-ms", "T", "exposure time, which blurs moving markers (default 4)", default=4.0)
    add_number(parser, "--rolling-shutter-ms", "T", "delay from the first to the last row (default 0)", default=0.0)
    add_number(parser, "--time-offset-ms", "T", "how late each camera is (default 0)", nargs="+", default=[])
    add_text(parser, "--ghosts", "N", "false bright blobs per camera (default 0)", type=int, default=0)
    add_number(parser, "--dropout", "P", "probability that a marker is missing (default 0)", default=0.0)
    add_number(parser, "--light-drift", "P", "relative change of the light over time (default 0)", default=0.0)
    add_switch(parser, "--moved-object", "a box appears after the background was taken")
    light = "light on room and body, as a fraction of full light (default 0.4)"
    add_number(parser, "--light", "P", light, default=default.light)
    add_switch(parser, "--no-clutter", "bare room")
    add_switch(parser, "--no-occlusion", "the body hides no markers")
    add_text(parser, "--seed", "N", "seed of noise, ghosts and dropout (default 0)", type=seed, default=0)


def _simulate_markers(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_fps(args.fps)
    check_ending(args.out)
    progress(0.0, "reading")
    motion = read_motion(args.motion, args.skeleton)
    if args.fps is not None:
        motion = resampled(motion, args.fps)
    take, truth = simulate_markers(motion, load_marker_set(args.marker_set), args.noise_mm, args.dropout, args.seed)
    progress(0.5, "writing")
    out = Path(args.out)
    stem = out.name.removesuffix(".take.npz") if out.name.endswith(".take.npz") else out.stem
    truth_path = out.with_name(f"{stem}.truth.bvh")
    write_take(take, out)
    write_bvh(truth, truth_path)
    return {
        "frames": take.frames,
        "fps": take.fps,
        "markers": list(take.names),
        "visible_fraction": float(take.visible.mean()),
        "take": str(out),
        "truth": str(truth_path),
    }


def _simulate_cameras(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_fps(args.fps)
    check_range("--background", args.background, 0, math.inf, "give 0 images or more")
    check_range("--board-views", args.board_views, 0, math.inf, "give 0 board poses or more")
    check_range("--t-pose", args.t_pose, 0.0, 60.0, "give 0 to 60 s")
    progress(0.0, "reading")
    motion = resampled(read_motion(args.motion, args.skeleton), args.fps)
    if not args.as_recorded:
        motion = on_stage(motion)
    motion = with_poses(motion, ("t",), args.t_pose)
    renderer = Renderer(default_rig(args.cameras), _studio_settings(args))
    source = simulated_source(motion, args.marker_set, renderer, fps=args.fps)
    files = RecordingFiles(args.background, args.board_views, *_CODECS[args.codec])
    return export_recording(source, args.out, files, progress)


def _studio_settings(args: argparse.Namespace) -> StudioSettings:
    return StudioSettings(
        marker_radius_m=1e-3 * args.marker_radius_mm,
        exposure_s=1e-3 * args.exposure_ms,
        noise_sigma=args.noise,
        time_offsets_s=tuple(1e-3 * offset for offset in args.time_offset_ms),
        rolling_shutter_s=1e-3 * args.rolling_shutter_ms,
        light=args.light,
        clutter=not args.no_clutter,
        ghosts=args.ghosts,
        moved_object=args.moved_object,
        light_drift=args.light_drift,
        occlusion=not args.no_occlusion,
        dropout=args.dropout,
        seed=args.seed,
    )
