"""A solved take: its poses and motions, and writing of its files."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..body.clock import Clock
from ..body.foot_lock import floor_of
from ..body.motion import Motion, every_nth, resampled
from ..body.scene_pose import DoubtfulStretch, PerformerPose, ScenePose, doubtful_stretches, mean_part_confidences
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import FormatError
from ..formats.markers.marker_files import is_recorded
from ..formats.markers.prop_csv import write_prop_csv
from ..formats.motion.write_motion import MOTION_ENDINGS, write_motion
from ..formats.take_file.chunks import ChunkKind
from ..formats.take_file.pose_codec import TimedPose
from ..formats.take_file.take_reader import TakeFile
from ..formats.take_file.take_setup import TakeNotes
from ..formats.take_file.whole_take import write_whole_take
from ..geometry.arrays import Array, Mask
from ..markers.marker_frame import MarkerFrame
from ..retarget.displayed_joint_names import OWN
from ..solver.settings import SolveSettings
from ..system.outputs import check_no_input
from .capture_setup import CaptureSetup
from .limb_coverage import near_limbs, with_left_out
from .steady_motion import motion_of, steady_motion
from .verdict import Reason, TakeVerdict, judge


@dataclass(frozen=True)
class SolvedTake:
    """Poses and motions of a take.

    Args:
        poses: Poses of all performers and props, one per frame.
        motions: Motion of each performer at a steady rate.
        seconds: Computing time of each frame (F,), without the second pass of a solve in both directions.
        relabelled: Mask (F,) of the frames whose labels were corrected with the help of later frames.
        clock: Times of the poses in the motions, and the motions' steady rate; None for poses alone.
        finish: Smoothing and foot lock of the motions; None if there is neither.
        setup: Cameras, performers, props, database and settings of this solve; None for poses alone.
        frames: Marker frames, each with the time at which it arrived, s.
        recording: Recorded take that was solved again; None for a marker take.
        report: Warnings and figures of this solve, by their names in the `solve` command's JSON object.
        findings: Problems of the first performer's motion found in the take's markers.
        faults: Stretches of the first performer in which labels are still wrong.
        corrected: Stretches whose wrong labels were corrected or removed before the solve.
        unused_m: Positions (F, N, 3) of a marker take's markers that were not used.
    """

    poses: tuple[ScenePose, ...]
    motions: tuple[Motion, ...]
    seconds: Array
    relabelled: Mask
    clock: Clock | None = None
    finish: Callable[[Motion], Motion] | None = None
    setup: CaptureSetup | None = None
    frames: Sequence[tuple[float, MarkerFrame]] = ()
    recording: TakeFile | None = None
    report: dict[str, Any] = field(default_factory=dict)
    findings: tuple[Reason, ...] = ()
    faults: tuple[DoubtfulStretch, ...] = ()
    corrected: tuple[DoubtfulStretch, ...] = ()
    unused_m: Array | None = None

    @property
    def motion(self) -> Motion:
        """Motion of the only or first performer."""
        return self.motions[0]

    @cached_property
    def verdict(self) -> TakeVerdict:
        """Verdict on the motion of the only or first performer."""
        return self.verdict_of(0)

    def verdict_of(self, performer: int) -> TakeVerdict:
        """Return the verdict on the motion of one performer, counted from 0."""
        rig = self.setup.rig if self.setup else None
        found = judge(
            self.motions[performer],
            self.poses_of(performer),
            self.setup.performers[performer] if self.setup else None,
            duration_s=self.clock.source_s if self.clock else self.motions[performer].duration_s,
            has_floor=rig is None or floor_of(rig) is not None,
            reasons=() if performer else self.findings,
            stretches=() if performer else self.faults,
        )
        if performer or self.unused_m is None or self.setup is None:
            return found
        body = motion_of(self.poses_of(), self.setup.performers[0], self.motion.name, self.motion.fps)
        return replace(found, limbs=with_left_out(found.limbs, near_limbs(body, self.unused_m)))

    def verdict_facts(self) -> dict[str, Any]:
        """Return the verdict's entries for the `solve` command's JSON object, with all doubtful stretches."""
        facts = self.verdict.facts()
        for stretch in (*self.corrected, *doubtful_stretches(self.poses_of())):
            facts["doubtful"].append(asdict(stretch) | {"reason": stretch.reason or "confidence is low"})
        return facts

    def motions_at(self, rate_hz: float | None) -> tuple[Motion, ...]:
        """Return the motions at another rate, resampled by the times of the poses; None keeps the take's rate."""
        if rate_hz is None or self.setup is None or self.clock is None:
            return tuple(motion if rate_hz is None else resampled(motion, rate_hz) for motion in self.motions)
        # for a lower rate, motions are smoothed and foot-locked at a multiple of it, because this needs about the
        # take's rate
        every = max(1, math.ceil(self.clock.fps / rate_hz)) if self.finish else 1
        poses, clock, found = self.recorded_poses(), self.clock.at(every * rate_hz), []
        for index, subject in enumerate(self.setup.performers):
            motion = steady_motion([pose.performers[index] for pose in poses], subject, self.motion.name, clock)
            found.append(every_nth(self.finish(motion) if self.finish else motion, every))
        return tuple(found)

    def poses_of(self, performer: int = 0) -> list[PerformerPose]:
        """Return the poses of one performer, counted from 0."""
        return [pose.performers[performer] for pose in self.poses]

    def recorded_poses(self) -> list[ScenePose]:
        """Return the poses between the countdown of a recording and its automatic end."""
        return [pose for pose in self.poses if self.recording is None or self.recording.is_recorded(pose.number)]

    def summary(self) -> dict[str, Any]:
        """Return figures for the `solve` command's output; errors and confidence are the first performer's."""
        first = self.poses_of()
        rms = np.array([pose.marker_rms_m for pose in first])
        return {
            "frames": len(self.poses),
            "marker_rms_mm": 1e3 * float(np.sqrt(np.nanmean(rms**2))) if np.isfinite(rms).any() else float("nan"),
            "ms_per_frame_median": 1e3 * float(np.median(self.seconds)),
            "ms_per_frame_p99": 1e3 * float(np.percentile(self.seconds, 99)),
            "confidence": float(np.mean([pose.confidence for pose in first])),
            "part_confidence": mean_part_confidences(first),
        }

    def joint_errors_deg(self) -> dict[str, float]:
        """Return the mean expected error of each joint except the root, by name; empty if unknown.

        The errors are the first performer's; 95 % of the actual errors are within twice the expected ones.
        """
        known = [pose.joint_errors_deg for pose in self.poses_of() if len(pose.joint_errors_deg)]
        return dict(zip(JOINT_NAMES[1:], np.mean(known, axis=0).tolist(), strict=True)) if known else {}

    def save(
        self,
        path: Path | str,
        units: str = "m",
        naming: str = OWN,
        rate_hz: float | None = None,
        capture: Mapping[str, Any] | None = None,
    ) -> None:
        """Write the motion or the whole take, depending on the file's extension.

        Motions of further performers and poses of props are written next to the motion, see `motion_paths`.

        Args:
            path: Motion (`.bvh`, `.angles.csv`, `.vrma`) or recorded take (`.perftake`); an existing file is replaced.
            units: Unit of lengths in BVH files, "m" or "cm".
            naming: Names of the joints in BVH and CSV files, one of `NAMINGS`.
            rate_hz: Frames per second of the written motion; None for the take's own rate.
            capture: Origin of the markers, which is stored in a recorded take made from a marker take.

        Raises:
            FormatError: The extension is not supported, or the path cannot be written or is that of the take itself.
        """
        if is_recorded(path):
            self._save_take(path, capture or {})
            return
        for motion, out in zip(self.motions_at(rate_hz), self.motion_paths(path), strict=True):
            write_motion(motion, out, units, naming)
        for index, prop in enumerate(self.setup.props if self.setup else ()):
            out = Path(path).with_name(f"{Path(path).stem}.{_plain(prop.name)}.csv")
            write_prop_csv(self.recorded_poses(), index, prop.name, out)

    def motion_paths(self, path: Path | str) -> list[Path]:
        """Return the path of each performer's motion: `path`, then paths that contain the other performers' names."""
        first = Path(path)
        ending = next((ending for ending in MOTION_ENDINGS if first.name.lower().endswith(ending)), first.suffix)
        stem = first.name[: len(first.name) - len(ending)]
        names = [subject.name for subject in self.setup.performers[1:]] if self.setup else []
        unlike = [name if names.count(name) == 1 else f"{name}-{number}" for number, name in enumerate(names, 2)]
        return [first, *(first.with_name(f"{stem}.{_plain(name)}{ending}") for name in unlike)]

    def _save_take(self, path: Path | str, capture: Mapping[str, Any]) -> None:
        """Write a recorded take; one that was solved again keeps its notes and events."""
        if self.setup is None:
            raise FormatError(
                "cannot be written: the markers of these poses are unknown",
                where=str(path),
                advice="write a motion file instead",
            )
        take, stamps_s = self.recording, [stamp_s for stamp_s, _ in self.frames]
        poses = [
            TimedPose(pose, stamp_s, float(seconds))
            for pose, stamp_s, seconds in zip(self.poses, stamps_s, self.seconds, strict=True)
        ]
        if take is None:
            notes = TakeNotes(self.motion.name, verdict=self.verdict.text)
            write_whole_take(path, self.setup.tables(capture), notes, list(self.frames), poses)
            return
        check_no_input(path, [take.path])
        before, tables = take.setup, self.setup.tables(take.setup.capture)
        name = take.notes.name.removesuffix(f" ({before.settings.get('method', SolveSettings().method)})")
        notes = TakeNotes(
            f"{name} ({self.setup.settings.method})",
            take.notes.notes,
            take.notes.rating,
            recorded=take.notes.recorded,
            verdict=self.verdict.text,
        )
        events = [bytes(chunk.payload) for chunk in take.chunks if chunk.kind == ChunkKind.EVENT]
        tables = replace(tables, created=before.created, software=before.software)
        write_whole_take(path, tables, notes, list(self.frames), poses, events)


def _plain(name: str) -> str:
    """Return a name in which only letters, digits, - and _ are kept."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
