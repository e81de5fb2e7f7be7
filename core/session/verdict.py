"""Verdict on a solved take: whether a viewer would accept the motion, and if not, why."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum, auto
from typing import Any, NamedTuple

import numpy as np

from ..body.body_parts import FOOT_JOINTS
from ..body.body_size import HUMAN, girth_scale, stature_m
from ..body.motion import Motion
from ..body.posture import posture_of
from ..body.scene_pose import DoubtfulStretch, PerformerPose
from ..body.skeleton import Skeleton
from ..body.standard_skeleton import default_skeleton
from ..geometry.arrays import Array, Mask, runs
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from .limb_coverage import LimbCoverage, limb_coverage, parts_of

GOOD = "good"

_LEGS = ("left leg", "right leg", "left foot", "right foot")
_LONG_BONES = {"femur": "thigh", "tibia": "shank", "humerus": "upper arm", "radius": "forearm"}


@dataclass(frozen=True)
class VerdictSettings:
    """Limits that a good motion meets, in addition to `PostureSettings`, as all CMU and Bandai takes do."""

    unsolved: float = 0.2  # largest share of frames without a solved pose
    wrong_m: float = 0.1  # median distance of markers from the body, over the take, above which no body was found
    limb_m: float = 0.08  # the same for the markers of one limb: a hand's width
    measured_share: float = 0.5  # factor of both limits for measured bodies, whose markers are within 20 mm
    noise_sigmas: float = 3.0  # multiple of the source's lasting errors that is added to all three distance limits
    stretch_m: float = 0.12  # median distance of a limb's markers in one frame above which the frame is doubtful
    stretch_s: float = 0.2  # shortest doubtful stretch
    bone_factor: float = 2.0  # largest ratio of a bone's length to that expected from the other bones, or its inverse
    hover_m: float = 0.3  # height of the lower foot's joint above the floor below which the body is on the floor
    hover_share: float = 0.1  # smallest share of the frames in which the body must be on the floor
    sink_m: float = 0.15  # largest depth of the lower foot's joint below the floor, median over the frames
    duration_s: float = 0.02  # largest difference from the source's duration
    duration_share: float = 0.01  # the same, as a share of the duration


class ReasonKind(Enum):
    """Checks that a solved take can fail, most serious first."""

    UNSOLVED = auto()
    MARKERS = auto()  # no body fits the markers
    SIZE = auto()
    UPRIGHT = auto()
    FLOOR = auto()
    LABELS = auto()  # the labels were guessed
    LIMB = auto()  # a limb is far from its markers
    DURATION = auto()
    STRETCH = auto()  # part of the take is doubtful


@dataclass(frozen=True)
class Reason:
    """Problem of a motion, with a sentence about it."""

    kind: ReasonKind
    text: str


@dataclass(frozen=True)
class TakeVerdict:
    """Verdict on one performer's motion.

    Args:
        reasons: Why the motion is not good, most serious first; empty for a good one.
        limbs: Coverage of the parts that carry markers, or should.
        stretches: Stretches in which the motion is doubtful, in order of time.
    """

    reasons: tuple[Reason, ...]
    limbs: tuple[LimbCoverage, ...]
    stretches: tuple[DoubtfulStretch, ...]

    @property
    def is_good(self) -> bool:
        """Whether the motion passes every check."""
        return not self.reasons

    @property
    def is_useless(self) -> bool:
        """Whether no body was found."""
        return any(reason.kind in (ReasonKind.UNSOLVED, ReasonKind.MARKERS) for reason in self.reasons)

    @property
    def text(self) -> str:
        """The first reason, or "good"."""
        return self.reasons[0].text if self.reasons else GOOD

    def facts(self) -> dict[str, Any]:
        """Return the verdict as shown in the `solve` command's JSON object."""
        return {
            "verdict": self.text,
            "limbs": [limb.facts() for limb in self.limbs],
            "doubtful": [asdict(stretch) for stretch in self.stretches],
        }


_S = VerdictSettings()


def judge(
    motion: Motion,
    poses: Sequence[PerformerPose],
    subject: Subject | None,
    *,
    duration_s: float,
    has_floor: bool = True,
    reasons: Sequence[Reason] = (),
    stretches: Sequence[DoubtfulStretch] = (),
) -> TakeVerdict:
    """Return the verdict on a performer's motion.

    Args:
        motion: Solved motion, y up.
        poses: Solved poses from which the motion was made, with the markers that were used.
        subject: Performer with the markers that were used; None if unknown.
        duration_s: Time between the first and the last frame of the source that the motion shows.
        has_floor: Whether y = 0 is the floor.
        reasons: Findings about the markers made before the solve.
        stretches: Stretches where labels are still wrong, found before the solve.
    """
    distances_m = _marker_distances(poses)
    marker_set = subject.marker_set if subject is not None else None
    parts = parts_of(marker_set) if marker_set is not None else {}
    limbs = limb_coverage(marker_set, distances_m) if marker_set is not None else ()
    limits = _limits_of(subject)
    far = _far_stretches(distances_m, parts, poses, limits.stretch_m)
    doubtful = sorted((*stretches, *far), key=lambda stretch: stretch.start_s)
    fitted_m = subject.residual_m if subject is not None else 0.0
    found = [*reasons, *_fit_reasons(poses, distances_m, fitted_m, limbs, limits)]
    found += _size_reasons(motion.skeleton)
    shown = {limb.limb for limb in limbs}
    # legs without markers are guessed, so they say nothing about the floor
    found += _posture_reasons(motion, has_floor and (marker_set is None or bool(shown & set(_LEGS))))
    found += _duration_reasons(motion, duration_s)
    found += [Reason(ReasonKind.STRETCH, _stretch_text(stretch)) for stretch in doubtful[:1]]
    return TakeVerdict(tuple(sorted(found, key=lambda reason: reason.kind.value)), limbs, tuple(doubtful))


def is_unsolved(poses: Sequence[PerformerPose]) -> Mask:
    """Return a mask (F,) of frames that only repeat the last pose, or are still the initial T pose."""
    return np.array([pose.confidence == 0.0 and not np.isfinite(pose.marker_rms_m) for pose in poses])


class _Limits(NamedTuple):
    """Limits for distances between located and solved markers, as in `VerdictSettings`."""

    wrong_m: float
    limb_m: float
    stretch_m: float


def _limits_of(subject: Subject | None) -> _Limits:
    """Return the limits for a performer: tighter for measured bodies, wider for points with lasting errors."""
    if subject is None:
        return _Limits(_S.wrong_m, _S.limb_m, _S.stretch_m)
    share = _S.measured_share if subject.residual_m > 0.0 else 1.0
    slack_m = _S.noise_sigmas * noise_of(subject.marker_set.points).lasting_m
    return _Limits(share * _S.wrong_m + slack_m, share * _S.limb_m + slack_m, _S.stretch_m + slack_m)


def _marker_distances(poses: Sequence[PerformerPose]) -> Array:
    """Return the distances (F, M) between located and solved markers, NaN where one was not located."""
    apart = np.array([pose.observed_m for pose in poses]) - np.array([pose.markers_m for pose in poses])
    return np.asarray(np.linalg.norm(apart, axis=-1))


def _far_stretches(
    distances_m: Array, parts: dict[str, list[int]], poses: Sequence[PerformerPose], most_m: float
) -> list[DoubtfulStretch]:
    """Return the stretches in which a part of the body is far from its markers."""
    times_s = np.array([pose.time_s for pose in poses]) - poses[0].time_s
    found = []
    for part, markers in parts.items():
        seen = np.isfinite(distances_m[:, markers]).any(axis=1)
        off_m = np.zeros(len(distances_m))
        off_m[seen] = np.nanmedian(distances_m[seen][:, markers], axis=1)
        for start, stop in runs(off_m > most_m):
            if times_s[stop - 1] - times_s[start] >= _S.stretch_s:
                reason = f"{part} is {1e3 * np.median(off_m[start:stop]):.0f} mm from its markers"
                found.append(
                    DoubtfulStretch(float(times_s[start]), float(times_s[stop - 1]), reason, part, start, stop - 1)
                )
    return found


def _stretch_text(stretch: DoubtfulStretch) -> str:
    return f"{stretch.reason}, {stretch.start_s:.2f} to {stretch.stop_s:.2f} s"


def _fit_reasons(
    poses: Sequence[PerformerPose],
    distances_m: Array,
    fitted_m: float,
    limbs: Sequence[LimbCoverage],
    limits: _Limits,
) -> list[Reason]:
    """Return the problems with the fit of the body to the markers.

    Args:
        fitted_m: RMS distance of the markers from the body when its bones were measured; 0 if they were not measured.
    """
    unsolved = float(np.mean(is_unsolved(poses)))
    if unsolved == 1.0:
        return [Reason(ReasonKind.UNSOLVED, "no frame shows the markers of the torso")]
    if unsolved > _S.unsolved:
        return [Reason(ReasonKind.UNSOLVED, f"{unsolved:.0%} of the frames show too little of the body")]
    known = distances_m[np.isfinite(distances_m)]
    off_m = max(fitted_m, float(np.median(known)) if len(known) else 0.0)
    if off_m >= limits.wrong_m:
        text = (
            f"no body fits the markers: the best one is {1e3 * off_m:.0f} mm off; "
            "check the markers' names, the unit and the subject"
        )
        return [Reason(ReasonKind.MARKERS, text)]
    far = [limb for limb in limbs if limb.distance_m > limits.limb_m]
    return [Reason(ReasonKind.LIMB, f"{limb.limb} is {1e3 * limb.distance_m:.0f} mm from its markers") for limb in far]


def _size_reasons(skeleton: Skeleton) -> list[Reason]:
    """Return the problems with the lengths of the bones."""
    scale, usual = girth_scale(skeleton), default_skeleton()
    height_m = stature_m(skeleton)
    if not HUMAN.shortest_m <= height_m <= HUMAN.tallest_m:
        return [Reason(ReasonKind.SIZE, f"the body is {height_m:.2g} m tall")]
    for bone, text in _LONG_BONES.items():
        for side, side_text in (("l", "left"), ("r", "right")):
            length_m = float(np.linalg.norm(skeleton.tips_m[skeleton.index(side + bone)]))
            expected_m = scale * float(np.linalg.norm(usual.tips_m[usual.index(side + bone)]))
            if not 1.0 / _S.bone_factor <= length_m / expected_m <= _S.bone_factor:
                words = f"the {side_text} {text} is {100.0 * length_m:.0f} cm long on a body {height_m:.2f} m tall"
                return [Reason(ReasonKind.SIZE, words)]
    return []


def _posture_reasons(motion: Motion, has_floor: bool) -> list[Reason]:
    """Return the problems with the body's posture and its height above the floor."""
    posture = posture_of(motion)
    if posture.is_never_upright:
        text = "upside down" if posture.is_upside_down else "lying down"
        advice = "check which axis of the take points up"
        return [Reason(ReasonKind.UPRIGHT, f"the body is {text} for the whole take; {advice}")]
    if not has_floor:
        return []
    feet = [motion.skeleton.index(name) for name in FOOT_JOINTS]
    lower = posture.positions_m[:, feet, 1].min(axis=1)
    lowest, usual = (float(np.percentile(lower, 100.0 * share)) for share in (_S.hover_share, 0.5))
    if lowest > _S.hover_m or usual < -_S.sink_m:
        place = f"{lowest:.2f} m above" if lowest > _S.hover_m else f"{-usual:.2f} m below"
        return [Reason(ReasonKind.FLOOR, f"the feet are {place} the floor (y = 0)")]
    return []


def _duration_reasons(motion: Motion, duration_s: float) -> list[Reason]:
    most_s = max(_S.duration_s, _S.duration_share * duration_s) + 1.0 / motion.fps
    if abs(motion.duration_s - duration_s) <= most_s:
        return []
    text = f"the motion lasts {motion.duration_s:.2f} s, its take {duration_s:.2f} s"
    return [Reason(ReasonKind.DURATION, text)]
