"""`perfanim take export`: write motion or markers of a recorded take to a file."""

import argparse
from pathlib import Path
from typing import Any

from ...errors import FormatError, SettingsError, TakeError, counted
from ...formats.markers.marker_files import WRITABLE, check_ending, is_recorded, read_take, write_take
from ...formats.markers.prop_csv import write_prop_csv
from ...formats.markers.recorded_take import marker_take
from ...formats.motion.write_motion import MOTION_ENDINGS, is_motion, write_motion
from ...formats.take_file.take_reader import ENDING, TakeFile, read_take_file
from ...markers.marker_take import MarkerTake
from ...markers.steady_take import take_clock
from ...session.steady_motion import pose_clock, steady_motion
from ...system.progress import Progress
from ..options import add_command, add_motion_options, add_text


def add_parser(group: Any) -> None:
    parser = add_command(group, "export", run, "motion or markers of a recorded take, as solved live")
    cut = f"recorded take ({ENDING}); if it was cut off, its intact part is exported"
    parser.add_argument("take", metavar="TAKE", help=cut)
    written = f"motion ({', '.join(MOTION_ENDINGS)}) or markers ({', '.join(WRITABLE)})"
    add_text(parser, "--out", "FILE", written, required=True)
    add_motion_options(parser)
    add_text(parser, "--prop", "NAME", "poses of this prop instead, as a table (.csv: metres, quaternion with w first)")
    add_text(parser, "--performer", "NAME", "motion of this further performer (default: of the first performer)")


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    out = Path(args.out)
    check_ending(out, (*MOTION_ENDINGS, *WRITABLE))
    if args.prop is not None and out.suffix.lower() != ".csv":
        raise SettingsError(
            "does not end in .csv", where=str(out), advice="a prop's poses are written as a table: name a .csv file"
        )
    progress(0.0, "reading")
    if not is_recorded(args.take):
        if args.prop is not None or args.performer is not None:
            raise FormatError(
                "holds the markers of one performer only, and no props",
                where=str(args.take),
                advice="name a .perftake for further performers and props",
            )
        markers = read_take(args.take)
        if is_motion(out):
            raise FormatError("holds markers, not motion", where=str(args.take), advice="solve it with perfanim solve")
        return _written(markers, out, [])
    take = read_take_file(args.take)
    warnings = list(take.problems)
    unsolved = take.frame_count - len(take.poses)
    if unsolved > 0:
        warnings.append(
            f"{counted(unsolved, 'frame')} not solved live and left out here: perfanim solve solves all frames"
        )
    if args.prop is not None:
        return _export_prop(take, args.prop, out, warnings)
    if is_motion(out):
        index = _performer_index(take, args.performer)
        poses, subject = take.recorded_poses_of(index), take.setup.subjects()[index]
        clock = pose_clock(poses, str(args.take))
        motion = steady_motion(poses, subject, take.notes.name, clock.at(args.rate))
        write_motion(motion, out, args.units, args.naming)
        warnings += clock.sentences
        return {"frames": motion.frames, "fps": motion.fps, "warnings": warnings, "out": str(out)}
    if args.performer is not None:
        raise SettingsError(
            "only the motion of a further performer can be exported", where=str(out), advice="name a motion file"
        )
    return _written(marker_take(take), out, warnings)


def _written(markers: MarkerTake, out: Path, warnings: list[str]) -> dict[str, Any]:
    """Write markers; return the facts."""
    written = write_take(markers, out)
    told = [*warnings, *markers.notes, *take_clock(markers).sentences]
    return {"frames": written.frames, "fps": written.fps, "warnings": told, "out": str(out)}


def _performer_index(take: TakeFile, name: str | None) -> int:
    """Return the index of a performer, 0 for None; TakeError if no performer has the name."""
    if name is None:
        return 0
    names = [subject.name for subject in take.setup.subjects()[1:]]
    if name in names:
        return 1 + names.index(name)
    advice = f"choose one of {', '.join(names)}" if names else "only one was recorded; solve the take with --performer"
    raise TakeError(f"has no further performer {name!r}", where=str(take.path), advice=advice)


def _export_prop(take: TakeFile, name: str, out: Path, warnings: list[str]) -> dict[str, Any]:
    names = [prop.name for prop in take.setup.carried_props()]
    if name not in names:
        advice = f"choose one of {', '.join(names)}" if names else "none was recorded; solve the take with --prop"
        raise TakeError(f"has no prop {name!r}", where=str(take.path), advice=advice)
    poses = take.recorded_poses
    if len(poses) < 2:
        raise TakeError(
            f"has {counted(len(poses), 'solved frame')}, but at least 2 are needed",
            where=str(take.path),
            advice="solve it again",
        )
    index = names.index(name)
    clock = write_prop_csv(poses, index, name, out)
    return {
        "frames": len(clock.steady_s),
        "fps": clock.fps,
        "found_fraction": sum(pose.props[index].found for pose in poses) / len(poses),
        "warnings": [*warnings, *clock.sentences],
        "out": str(out),
    }
