"""`perfanim simulate cameras`: videos of a motion, with all truth."""

import argparse
from typing import Any

from ..body.motion import resampled
from ..errors import SettingsError
from ..formats.motion.read_motion import read_motion
from ..simulate.studio.export_recording import RecordingFiles, export_recording
from ..simulate.studio.render import Renderer
from ..simulate.studio.simulated_source import simulated_source
from ..simulate.studio.stage_placement import on_stage, with_poses
from ..simulate.studio.studio_rig import FPS, default_rig
from ..simulate.studio.studio_settings import StudioSettings
from ..simulate.studio.video import LOSSLESS
from ..system.progress import Progress
from .options import add_choice, add_number, add_switch, add_text, seed

_CODECS = {"huffyuv": LOSSLESS, "ffv1": (".mkv", "FFV1"), "mjpeg": (".avi", "MJPG"), "mpeg4": (".mp4", "mp4v")}


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "cameras", help="videos of two or more cameras, pictures of the board, and all truth, made from motion"
    )
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of an AMC file")
    add_text(parser, "--out", "DIR", "new folder for everything", required=True)
    add_text(parser, "--marker-set", "NAME", "shipped marker set or TOML file (default boxing)", default="boxing")
    add_text(parser, "--cameras", "N", "how many cameras (default 2)", type=int, default=2)
    add_number(parser, "--fps", "HZ", "images per second (default 60)", default=FPS)
    add_number(parser, "--t-pose", "S", "T pose before the motion, seconds (default 2; 0: none)", default=2.0)
    add_switch(parser, "--as-recorded", "leave the motion where it is instead of bringing it before the cameras")
    _add_studio_options(parser)
    add_text(parser, "--background", "N", "images of the empty room (default 60)", type=int, default=60)
    add_text(parser, "--board-views", "N", "positions of the board (default 24)", type=int, default=24)
    add_choice(
        parser,
        "--codec",
        sorted(_CODECS),
        "huffyuv (default) and ffv1 keep every grey level; others are smaller",
        default="huffyuv",
    )
    parser.set_defaults(run=run)


def _add_studio_options(parser: argparse.ArgumentParser) -> None:
    default = StudioSettings()
    add_number(parser, "--noise", "S", "sensor noise, grey levels (default 2)", default=default.noise_sigma)
    add_number(parser, "--marker-radius-mm", "R", "default 12.5", default=1e3 * default.marker_radius_m)
    add_number(parser, "--exposure-ms", "T", "time that smears moving markers (default 4)", default=4.0)
    add_number(parser, "--rolling-shutter-ms", "T", "first to last row (default 0)", default=0.0)
    add_number(parser, "--time-offset-ms", "T", "how late each camera is (default 0)", nargs="+", default=[])
    add_text(parser, "--ghosts", "N", "false bright blobs per camera (default 0)", type=int, default=0)
    add_number(parser, "--dropout", "P", "chance of a marker to be missing (default 0)", default=0.0)
    add_number(parser, "--light-drift", "P", "change of the light, share (default 0)", default=0.0)
    add_switch(parser, "--moved-object", "a box appears after the background was taken")
    add_number(parser, "--light", "P", "of room and body, share of full light (default 0.4)", default=default.light)
    add_switch(parser, "--no-clutter", "bare room")
    add_switch(parser, "--no-occlusion", "the body hides no markers")
    add_text(parser, "--seed", "N", "of noise, ghosts and dropout (default 0)", type=seed, default=0)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if not 1.0 <= args.fps <= 1000.0:
        raise SettingsError(f"{args.fps} images per second", where="--fps", advice="give 1 to 1000")
    if min(args.background, args.board_views) < 0 or not 0.0 <= args.t_pose <= 60.0:
        raise SettingsError("numbers of images and the T pose's time cannot be negative")
    progress(0.0, "reading")
    motion = resampled(read_motion(args.motion, args.skeleton), args.fps)
    if not args.as_recorded:
        motion = on_stage(motion)
    motion = with_poses(motion, ("t",), args.t_pose)
    renderer = Renderer(default_rig(args.cameras), _settings(args))
    source = simulated_source(motion, args.marker_set, renderer, fps=args.fps)
    extension, codec = _CODECS[args.codec]
    files = RecordingFiles(args.background, args.board_views, extension, codec)
    return export_recording(source, args.out, files, progress)


def _settings(args: argparse.Namespace) -> StudioSettings:
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
