"""Solved poses of performers and props at one moment."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask, runs
from .body_parts import PARTS
from .pose_notes import PoseNote

DOUBTFUL = 0.3  # confidence below which a pose is probably wrong
_TOGETHER_S = 0.1  # longest pause between equal notes that are reported as one
_REASON = 0.25  # fraction of the poses in a passage that must have a note for that to be the reason
# expected errors above which parts are probably wrong; those of hands and feet are usually larger
DOUBTFUL_PART_DEG = np.array([40.0 if part.endswith(("hand", "foot")) else 25.0 for part in PARTS])


@dataclass(frozen=True)
class PropPose:
    """Pose of one prop at one moment.

    Args:
        rotation: World-from-prop quaternion (4,).
        position_m: The prop's origin (3,) in the world.
        rms_m: RMS distance between its located markers and those of the rigid prop; NaN if none was located.
        seen: Number of its markers that any camera saw; 0 if the prop was not found. It then keeps its last pose, or is
            at the origin before the first.
    """

    rotation: Array
    position_m: Array
    rms_m: float = float("nan")
    seen: int = 0

    @property
    def found(self) -> bool:
        """Whether any camera saw the prop."""
        return self.seen > 0


@dataclass(frozen=True)
class PerformerPose:
    """Solved pose of one performer at one moment.

    Args:
        rotations: Parent-from-joint quaternions (J, 4) relative to rest; the root's is world-from-root.
        root_position_m: World position (3,) of the root.
        confidence: 0 (guessed) to 1: the geometric mean of the confidences in the parts (see `part_confidences`),
            lowered if markers are unexplained, labels uncertain, or the body tilted unlike its examples. For methods
            other than "best", the agreement (see `tracking_quality.Fit`).
        markers_m: The subject's markers (M, 3) on the solved pose.
        observed_m: Positions (M, 3) where the markers were located, NaN elsewhere.
        single_cameras: The only camera (M,) that saw each marker; -1 if none did or the marker was located.
        marker_rms_m: RMS distance between located and solved markers; NaN if none was located.
        neighbours: Number of neighbours, K, of the local model.
        dimensions: Number of dimensions, B, of the local model.
        notes: Problems of this pose.
        single_points: Image points (M, 2) of these markers in that camera, undistorted and normalised, NaN elsewhere;
            empty in poses read from takes, which store these points by blob.
        part_errors_deg: Expected errors (P,) of the body's parts (`body_parts.PARTS`), means over their joints: most
            errors are within twice that. Empty for methods other than "best", and in takes of earlier versions.
        joint_errors_deg: The same (J - 1,) for each joint except the root; also empty in poses read from takes.
    """

    number: int
    time_s: float
    rotations: Array
    root_position_m: Array
    confidence: float
    markers_m: Array
    observed_m: Array
    single_cameras: IntArray
    marker_rms_m: float
    neighbours: int = 0
    dimensions: int = 0
    notes: tuple[PoseNote, ...] = ()
    single_points: Array = field(default_factory=lambda: np.empty((0, 2)))
    part_errors_deg: Array = field(default_factory=lambda: np.empty(0))
    joint_errors_deg: Array = field(default_factory=lambda: np.empty(0))

    @property
    def seen(self) -> Mask:
        """Mask (M,) of markers that any camera saw."""
        return np.isfinite(self.observed_m[:, 0]) | (self.single_cameras >= 0)

    @property
    def doubtful(self) -> bool:
        """Whether the whole pose is probably wrong."""
        return self.confidence < DOUBTFUL

    @property
    def part_confidences(self) -> Array:
        """Confidences (P,) in the parts, lowered like `confidence`; empty if the errors are unknown."""
        if not len(self.part_errors_deg):
            return np.empty(0)
        return self._lowered * part_confidences(self.part_errors_deg)

    def with_part_errors(self, errors_deg: Array) -> "PerformerPose":
        """Return the pose with other expected errors (P,) of its parts, which change its confidence accordingly."""
        if not len(self.part_errors_deg):
            return replace(self, part_errors_deg=errors_deg)
        return replace(self, part_errors_deg=errors_deg, confidence=self._lowered * body_confidence(errors_deg))

    @property
    def _lowered(self) -> float:
        """Factor by which markers, labels and tilt lower the confidence."""
        return min(self.confidence / max(body_confidence(self.part_errors_deg), 1e-9), 1.0)

    @property
    def doubtful_parts(self) -> list[str]:
        """The parts that are probably wrong by their expected errors."""
        return doubtful_parts(self.part_errors_deg)


def part_confidences(errors_deg: Array) -> Array:
    """Return the confidences (..., P) in parts with expected errors (..., P): 1 for none, `DOUBTFUL` at the limit."""
    return np.asarray(DOUBTFUL ** np.square(errors_deg / DOUBTFUL_PART_DEG))


def body_confidence(errors_deg: Array) -> float:
    """Return the geometric mean of the confidences in parts with expected errors (P,); 1 if these are unknown (0,)."""
    return float(np.exp(np.log(part_confidences(errors_deg)).mean())) if len(errors_deg) else 1.0


def mean_part_confidences(poses: Sequence[PerformerPose]) -> dict[str, float]:
    """Return the mean confidence in each part, by its name; empty if all errors are unknown."""
    rows = [pose.part_confidences for pose in poses]
    if not any(map(len, rows)):
        return {}
    filled = [row if len(row) else np.full(len(PARTS), pose.confidence) for pose, row in zip(poses, rows, strict=True)]
    return dict(zip(PARTS, np.mean(filled, axis=0).tolist(), strict=True))


def doubtful_parts(errors_deg: Array) -> list[str]:
    """Return the parts with large expected errors (P,); none if the errors are unknown (0,)."""
    if not len(errors_deg):
        return []
    return [part for part, large in zip(PARTS, (errors_deg > DOUBTFUL_PART_DEG).tolist(), strict=True) if large]


@dataclass(frozen=True)
class ScenePose:
    """Solved poses of all performers and props of a capture at one moment.

    Args:
        performers: Pose of each performer, in the capture's order.
        props: Pose of each prop, in the capture's order.
        notes: Problems of all performers and props.
    """

    performers: tuple[PerformerPose, ...]
    props: tuple[PropPose, ...] = ()
    notes: tuple[PoseNote, ...] = ()

    @property
    def number(self) -> int:
        """Number of the marker frame."""
        return self.performers[0].number

    @property
    def time_s(self) -> float:
        """Time of the marker frame."""
        return self.performers[0].time_s


@dataclass(frozen=True)
class DoubtfulStretch:
    """Passage of a take in which a performer's poses are probably wrong.

    Args:
        start_s, stop_s: Time since the first pose.
        reason: Most frequent note on its poses, or on that part in them; "" if no note is frequent.
        part: Part of the body; "" for the whole pose.
        first, last: First and last frame, counted from 0.
    """

    start_s: float
    stop_s: float
    reason: str
    part: str
    first: int
    last: int


@dataclass(frozen=True)
class Decision:
    """Decision of the solver that is noted in a passage of a take, with the reason.

    Args:
        start_s, stop_s: Time since the first pose.
        kind: Name of the kind of note (`pose_notes.NoteKind`).
        reason: Text of the note.
        first, last: First and last frame, counted from 0.
    """

    start_s: float
    stop_s: float
    kind: str
    reason: str
    first: int
    last: int


def decisions(poses: Sequence[ScenePose]) -> list[Decision]:
    """Return what the solver decided in successive poses, in order of time."""
    open_at: dict[PoseNote, list[int]] = {}  # first and last frame
    found: list[tuple[int, int, PoseNote]] = []
    for at, pose in enumerate(poses):
        for note in pose.notes:
            if not note.tells_why:
                continue
            span = open_at.get(note)
            if span is not None and pose.time_s - poses[span[1]].time_s <= _TOGETHER_S:
                span[1] = at
                continue
            if span is not None:
                found.append((span[0], span[1], note))
            open_at[note] = [at, at]
    found += [(first, last, note) for note, (first, last) in open_at.items()]
    begin_s = poses[0].time_s if poses else 0.0
    return [
        Decision(poses[first].time_s - begin_s, poses[last].time_s - begin_s, note.kind.name, note.text, first, last)
        for first, last, note in sorted(found, key=lambda each: each[:2])
    ]


def doubtful_stretches(poses: Sequence[PerformerPose]) -> list[DoubtfulStretch]:
    """Return the passages in which a performer's whole pose is doubtful, then those in which single parts are."""
    stretches = _stretches(poses, [pose.doubtful for pose in poses])
    for part in PARTS:
        stretches += _stretches(poses, [not pose.doubtful and part in pose.doubtful_parts for pose in poses], part)
    return stretches


def _stretches(poses: Sequence[PerformerPose], doubtful: Sequence[bool], part: str = "") -> list[DoubtfulStretch]:
    found = []
    for start, stop in runs(np.array(doubtful, dtype=np.bool_)):
        told = [note for pose in poses[start:stop] for note in pose.notes if not note.is_decision]
        notes = Counter(note for note in told if not part or note.part == part)
        reason = next((note.text for note, count in notes.most_common(1) if count >= _REASON * (stop - start)), "")
        begin_s, end_s = (poses[at].time_s - poses[0].time_s for at in (start, stop - 1))
        found.append(DoubtfulStretch(begin_s, end_s, reason, part, start, stop - 1))
    return found
