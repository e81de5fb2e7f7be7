"""Requests to solve one take, labelled or recorded, as files and options."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.foot_lock import floor_of, hold_feet
from ..body.motion import Motion
from ..body.scene_pose import doubtful_stretches
from ..body.skeleton import marker_positions
from ..database.store import Database, check_file, identity
from ..errors import SubjectError, TakeError
from ..formats.markers.marker_files import is_recorded, read_take
from ..formats.markers.prop_csv import write_prop_csv
from ..formats.markers.recorded_take import marker_take
from ..formats.motion.read_motion import read_skeleton
from ..formats.motion.write_motion import write_motion
from ..formats.take_file.take_reader import TakeFile, read_take_file
from ..geometry.arrays import runs
from ..geometry.camera import CameraRig
from ..geometry.rig_file import load_rig
from ..labelling.take_import import import_take
from ..markers.filtering import smooth_motion, smooth_take
from ..markers.label_matching import AUTO, load_names, match_best_set, match_labels, rename_labels
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.marker_take import MarkerTake
from ..markers.prop import load_prop
from ..markers.subject import Subject, load_subject
from ..markers.take_frames import is_unnamed
from ..retarget.joint_naming import OWN
from ..solver.marker_selection import choose_markers, with_markers, worn_in
from ..solver.settings import SolveSettings
from ..system.outputs import check_no_input
from ..system.progress import Progress
from .capture_setup import CaptureSetup
from .save_solved_take import save_resolved_take
from .session_cache import SessionCache
from .solve_take import SolvedTake, solve_recorded, solve_take

Facts = dict[str, Any]
# From a labelled take and a body, the body corrected by it and the changes in words. The package that does it
# stands above this one.
Refine = Callable[[MarkerTake, Subject, Database, Progress], tuple[Subject, list[str]]]

_REFINING_SHARE = 0.2  # of the time, roughly; solving then begins at 0 again


@dataclass(frozen=True)
class BodyFiles:
    """Files of the performer: a subject, or a skeleton with a marker set."""

    subject: str | None = None
    skeleton: str | None = None
    marker_set: str | None = None  # name or file; None for the subject's

    def load_marker_set(self, take: MarkerTake | None = None, where: str = "") -> MarkerSet | None:
        """Return the marker set, for AUTO by the take's labels; None for the subject's."""
        if self.marker_set == AUTO and take is not None:
            return match_best_set(take.names, where).marker_set
        return load_marker_set(self.marker_set) if self.marker_set is not None else None

    def load_subject(self, markers: MarkerSet | None, where: str, recorded: Subject | None = None) -> Subject:
        """Return the subject with these markers, or with its own.

        Raises:
            SubjectError: a skeleton has no marker set, or the subject was calibrated without a marker.
        """
        if self.skeleton is not None:
            if markers is None:
                raise SubjectError("a skeleton carries no markers", advice="name the marker set that was worn")
            return Subject(Path(self.skeleton).stem, read_skeleton(self.skeleton), markers)
        subject = load_subject(self.subject) if self.subject is not None else recorded
        if subject is None:
            raise SubjectError(
                "names no performer", where=where, advice="name a subject, or a skeleton and a marker set"
            )
        if markers is None:
            return subject
        known = {marker.name: marker for marker in subject.marker_set.markers}
        uncalibrated = [m.name for m in markers.markers if m.name not in known and m.offset_m is None]
        if uncalibrated:
            raise SubjectError(
                "no offset is known for " + ", ".join(uncalibrated),
                where=str(self.subject or where),
                advice="calibrate the subject with this marker set",
            )
        worn = tuple(known.get(marker.name, marker) for marker in markers.markers)
        return Subject(subject.name, subject.skeleton, MarkerSet(markers.name, worn), subject.residual_m)


@dataclass(frozen=True)
class MotionOutput:
    """Motion file or recorded take to write, with options.

    Args:
        units, naming, rate_hz: as of `write_motion`.
        smooth_hz: low-pass of labelled markers before and of motion after; None for none.
        feet: mode of `hold_feet`.
    """

    path: str
    units: str = "m"
    naming: str = OWN
    rate_hz: float | None = None
    smooth_hz: float | None = None
    feet: str = "off"

    @property
    def is_take(self) -> bool:
        """Whether the file is a recorded take."""
        return is_recorded(self.path)

    def beside(self, name: str, ending: str) -> Path:
        """Return the file for a further target beside the performer's motion."""
        plain = "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
        return Path(self.path).with_name(f"{Path(self.path).stem}.{plain}{ending}")

    def write(self, solved: SolvedTake, facts: Facts, floor_m: Callable[[], float | None]) -> tuple[SolvedTake, Facts]:
        """Smooth the motions, hold the feet, write them; return poses and facts."""
        motions = list(solved.motions)
        if self.smooth_hz is not None:
            motions = [smooth_motion(motion, self.smooth_hz) for motion in motions]
        if self.feet != "off":
            height_m = floor_m()
            motions = [hold_feet(motion, self.feet, height_m) for motion in motions]
        if not self.is_take:
            outs = [self.path, *(performer["out"] for performer in facts.get("performers", ()))]
            for motion, out in zip(motions, outs, strict=True):
                facts = facts | {"fps": write_motion(motion, out, self.units, self.naming, self.rate_hz).fps}
        return replace(solved, motions=tuple(motions)), facts


@dataclass(frozen=True)
class SolveMarkers:
    """Solve a take of labelled markers.

    Args:
        names: file from labels to markers; None for none.
        use: names of markers to solve with, or how many to choose; None for all.
        up: axis of the file that points up, as of `import_take`; None for y in metres, as it is.
        causal: each pose by earlier frames alone, see `solve_take`.
        refine: corrects the body by the take before; None for the body as it is.
    """

    take: str
    database: str
    body: BodyFiles
    output: MotionOutput
    names: str | None = None
    use: str | None = None
    up: str | None = None
    method: str | None = None
    causal: bool = False
    refine: Refine | None = None

    def run(self, progress: Progress, cache: SessionCache) -> tuple[SolvedTake, Facts]:
        """Solve, write the motion, return poses and facts."""
        take = read_take(self.take)
        if self.names is not None:
            take = rename_labels(take, load_names(self.names))
        subject = self.body.load_subject(self.body.load_marker_set(take, self.take), self.take)
        if self.up is not None:
            take = import_take(take, subject.marker_set, self.up)
        elif not is_unnamed(take):
            take = match_labels(take.names, subject.marker_set).rename(take)
        if self.output.smooth_hz is not None:
            take = smooth_take(take, self.output.smooth_hz)
        settings, database = SolveSettings(method=self.method or "best"), cache.database(self.database)
        changes: Facts = {}
        if self.refine is not None:
            subject, changes["changes"] = self.refine(take, subject, database, _first_part(progress))
        worn, facts = self._worn_subject(take, subject, database)
        solved = solve_take(take, worn, database, settings, progress, cache.session, self.causal)
        check_file(database)
        if self.use is not None:
            facts["left_out_rms_mm"] = 1e3 * _left_out_rms_m(take, subject, worn, solved.motion)
        facts = (
            {
                "method": settings.method,
                "marker_set": subject.marker_set.name,
                "markers": sum(name in take.names for name in subject.marker_set.names),
                "warnings": _label_differences(take, subject),
            }
            | changes
            | facts
        )
        return self.output.write(solved, facts, lambda: None)

    def _worn_subject(self, take: MarkerTake, subject: Subject, database: Database) -> tuple[Subject, Facts]:
        """Return the subject with the markers to solve with, and facts about their choice."""
        if self.use is None:
            return worn_in(take, subject), {}
        if not self.use.strip().isdecimal():
            worn = with_markers(subject, [name.strip() for name in self.use.split(",") if name.strip()])
            return worn, {"used": list(worn.marker_set.names)}
        seen = [name for name, visible in zip(take.names, take.visible.T, strict=True) if visible.any()]
        choice = choose_markers(subject, database, int(self.use.strip()[:9]), seen)
        worn = with_markers(subject, choice.names)
        return worn, {"used": list(choice.names), "expected_mm": (1e3 * choice.expected_m).round(1).tolist()}


def _first_part(progress: Progress) -> Progress:
    """Return the progress of work that comes before solving."""
    return lambda share, text: progress(_REFINING_SHARE * share, text)


def _left_out_rms_m(take: MarkerTake, subject: Subject, worn: Subject, motion: Motion) -> float:
    """Return the RMS distance of the markers not solved with, NaN for none."""
    left_out = [n for n in subject.marker_set.names if n in take.names and n not in worn.marker_set.names]
    if not left_out:
        return float("nan")
    rest = subject.marker_set.subset(left_out)
    joints = rest.joint_indices(motion.skeleton)
    solved = marker_positions(motion.skeleton, joints, rest.offsets_m, motion.rotations, motion.root_positions_m)
    measured = take.positions_m[:, [take.names.index(name) for name in rest.names]]
    return float(np.sqrt(np.nanmean(np.sum((solved - measured) ** 2, axis=-1))))


def _label_differences(take: MarkerTake, subject: Subject) -> list[str]:
    """Return warnings about labels that only the take or only the subject has."""
    if is_unnamed(take):
        return []
    worn = subject.marker_set.names
    lacking = [name for name in worn if name not in take.names]
    unused = [name for name in take.names if name not in worn]
    return [f"not in the take: {', '.join(lacking)}"] * bool(lacking) + [
        f"not in the marker set, left out: {', '.join(unused)}"
    ] * bool(unused)


def _stretches(solved: SolvedTake) -> list[Facts]:
    """Return the stretches with labels from later frames, in seconds from the start."""
    times_s = [pose.time_s - solved.poses[0].time_s for pose in solved.poses]
    return [{"start_s": times_s[start], "stop_s": times_s[stop - 1]} for start, stop in runs(solved.relabelled)]


@dataclass(frozen=True)
class SolveRecorded:
    """Solve a recorded take again.

    Args:
        take: the file; its set-up replaces None and empty values here.
        performers: files of further performers.
        causal: as live, see `solve_recorded`.
        refine: as of `SolveMarkers`, of the first performer, by the labels as recorded.
        retriangulate: function needed with `cameras`; this package loads no OpenCV.
    """

    take: str
    body: BodyFiles
    output: MotionOutput
    database: str | None = None
    cameras: str | None = None
    props: Sequence[str] = ()
    performers: Sequence[str] = ()
    method: str | None = None
    causal: bool = False
    refine: Refine | None = None
    retriangulate: Callable[[CameraRig, Sequence[MarkerFrame]], Iterable[MarkerFrame]] | None = None

    def run(self, progress: Progress, cache: SessionCache) -> tuple[SolvedTake, Facts]:
        """Solve, write the output, return poses and facts."""
        take = read_take_file(self.take)
        rig, frames = take.setup.camera_rig(), take.frames
        if self.cameras is not None and self.retriangulate is not None:
            progress(0.0, "triangulating the markers again")
            rig = load_rig(self.cameras)
            frames = tuple(self.retriangulate(rig, frames))
        recorded = take.setup.subjects()
        subject = self.body.load_subject(self.body.load_marker_set(), self.take, recorded[0] if recorded else None)
        further: Sequence[Subject] = recorded[1:]
        settings = self._settings(take)
        path = self.database or take.setup.database.get("path", "")
        if not path:
            raise TakeError("names no motion database", where=self.take, advice="name one")
        database = cache.database(path)
        changes: Facts = {}
        if self.refine is not None:
            subject, changes["changes"] = self.refine(marker_take(take), subject, database, _first_part(progress))
        out = Path(self.output.path)
        check_no_input(out, [self.take])
        props = tuple(load_prop(prop) for prop in self.props) if self.props else take.setup.carried_props()
        if self.performers:
            further = [load_subject(performer) for performer in self.performers]
        setup = CaptureSetup(rig, (subject, *further), props, database, settings)
        solved = solve_recorded(take, frames, setup, progress, cache.session, self.causal)
        check_file(database)
        if self.output.is_take:
            save_resolved_take(out, take, frames, setup, solved)
        warnings = list(take.problems)
        if self.database is None and identity(database)["sha256"] != take.setup.database.get("sha256"):
            warnings.append(f"{path} has changed since the take was recorded")
        facts: Facts = {"method": settings.method, "warnings": warnings, "complete": take.complete} | changes
        facts |= {"relabelled": _stretches(solved), "doubtful": [*map(asdict, doubtful_stretches(solved.poses_of()))]}
        if props:
            facts["props"] = self._write_props(take, solved, setup)
        if further:
            facts["performers"] = self._further_performers(take, solved, [subject.name for subject in further])
        return self.output.write(solved, facts, lambda: floor_of(rig))

    def _settings(self, take: TakeFile) -> SolveSettings:
        given = dict(take.setup.settings) | ({"method": self.method} if self.method else {})
        try:
            return SolveSettings.of_table(given)
        except TypeError as error:
            raise TakeError(f"was solved with settings that are unknown here ({error})", where=self.take) from error

    def _write_props(self, take: TakeFile, solved: SolvedTake, setup: CaptureSetup) -> dict[str, float]:
        """Write the props' motions beside a motion; return each one's share of frames."""
        poses = [pose for pose in solved.poses if take.is_recorded(pose.number)]
        if not self.output.is_take:
            for index, prop in enumerate(setup.props):
                write_prop_csv(poses, index, prop.name, solved.motion.fps, self.output.beside(prop.name, ".csv"))
        found = ([pose.props[index].found for pose in poses] for index in range(len(setup.props)))
        return {prop.name: sum(row) / len(poses) for prop, row in zip(setup.props, found, strict=True)}

    def _further_performers(self, take: TakeFile, solved: SolvedTake, names: Sequence[str]) -> list[Facts]:
        """Return name, mean confidence and the motion's file of each further performer."""
        facts = []
        for index, name in enumerate(names):
            sure = [pose.confidence for pose in solved.poses_of(1 + index) if take.is_recorded(pose.number)]
            fact: Facts = {"name": name, "confidence": float(np.mean(sure))}
            if not self.output.is_take:
                unlike = name if names.count(name) == 1 else f"{name}-{index + 2}"
                fact["out"] = str(self.output.beside(unlike, Path(self.output.path).suffix))
            facts.append(fact)
        return facts
