"""`perfanim simulate cameras`: videos of a motion, with all truth."""

import argparse
from typing import Any

from ..body.motion import resampled
from ..errors import SettingsError
from ..formats.motion.read_motion import read_motion
from ..simulate.studio.export import RecordingFiles, export_recording
from ..simulate.studio.placement import on_stage, with_t_pose
from ..simulate.studio.render import Renderer
from ..simulate.studio.rig import FPS, default_rig
from ..simulate.studio.settings import StudioSettings
from ..simulate.studio.source import simulated_source
from ..system.progress import Progress
from .options import seed

_CODECS = {"ffv1": (".mkv", "FFV1"), "mjpeg": (".avi", "MJPG"), "mpeg4": (".mp4", "mp4v")}


def add_parser(subparsers: Any) -> None:
    """Add `cameras` to the `simulate` group."""
    parser = subparsers.add_parser(
        "cameras", help="videos of two or more cameras, pictures of the board, and all truth, made from motion"
    )
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    parser.add_argument("--skeleton", metavar="FILE.asf", help="skeleton of an AMC file")
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder for everything")
    parser.add_argument(
        "--marker-set", default="boxing", metavar="NAME", help="shipped marker set or TOML file (default boxing)"
    )
    parser.add_argument("--cameras", type=int, default=2, metavar="N", help="how many cameras (default 2)")
    parser.add_argument("--fps", type=float, default=FPS, metavar="HZ", help="images per second (default 60)")
    parser.add_argument(
        "--t-pose", type=float, default=2.0, metavar="S", help="T pose before the motion, seconds (default 2; 0: none)"
    )
    parser.add_argument(
        "--as-recorded",
        action="store_true",
        help="leave the motion where it is instead of bringing it before the cameras",
    )
    _add_studio_options(parser)
    parser.add_argument("--background", type=int, default=60, metavar="N", help="images of the empty room (default 60)")
    parser.add_argument("--board-views", type=int, default=24, metavar="N", help="positions of the board (default 24)")
    parser.add_argument(
        "--codec",
        choices=sorted(_CODECS),
        default="ffv1",
        help="ffv1 keeps every grey level (default); others are smaller",
    )
    parser.set_defaults(run=run)


def _add_studio_options(parser: argparse.ArgumentParser) -> None:
    default = StudioSettings()
    parser.add_argument(
        "--noise", type=float, default=default.noise_sigma, metavar="S", help="sensor noise, grey levels (default 2)"
    )
    parser.add_argument(
        "--marker-radius-mm", type=float, default=1e3 * default.marker_radius_m, metavar="R", help="default 12.5"
    )
    parser.add_argument(
        "--exposure-ms", type=float, default=4.0, metavar="T", help="time that smears moving markers (default 4)"
    )
    parser.add_argument(
        "--rolling-shutter-ms", type=float, default=0.0, metavar="T", help="first to last row (default 0)"
    )
    parser.add_argument(
        "--time-offset-ms", type=float, nargs="+", default=[], metavar="T", help="how late each camera is (default 0)"
    )
    parser.add_argument("--ghosts", type=int, default=0, metavar="N", help="false bright blobs per camera (default 0)")
    parser.add_argument(
        "--dropout", type=float, default=0.0, metavar="P", help="chance of a marker to be missing (default 0)"
    )
    parser.add_argument(
        "--light-drift", type=float, default=0.0, metavar="P", help="change of the light, share (default 0)"
    )
    parser.add_argument("--moved-object", action="store_true", help="a box appears after the background was taken")
    parser.add_argument(
        "--light",
        type=float,
        default=default.light,
        metavar="P",
        help="of room and body, share of full light (default 0.4)",
    )
    parser.add_argument("--no-clutter", action="store_true", help="bare room")
    parser.add_argument("--no-occlusion", action="store_true", help="the body hides no markers")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of noise, ghosts and dropout (default 0)")


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Write the recording; returns its summary."""
    if not 1.0 <= args.fps <= 1000.0:
        raise SettingsError(f"{args.fps} images per second", where="--fps", advice="give 1 to 1000")
    if min(args.background, args.board_views) < 0 or not 0.0 <= args.t_pose <= 60.0:
        raise SettingsError("numbers of images and the T pose's time cannot be negative")
    progress(0.0, "reading")
    motion = resampled(read_motion(args.motion, args.skeleton), args.fps)
    if not args.as_recorded:
        motion = on_stage(motion)
    motion = with_t_pose(motion, args.t_pose)
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
