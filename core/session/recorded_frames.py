"""Labels of recorded takes, corrected with the help of later frames.

Live, alternative labels replace the current ones only once there is enough evidence. In a recorded take they can also
apply earlier: the session tracks the body backwards in time for as long as they explain the markers better than the
live labels. The frames with new labels are then solved again.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..body.pose_notes import NoteKind, PoseNote
from ..body.scene_pose import PerformerPose, ScenePose
from ..geometry.arrays import Array, Mask, runs
from ..markers.marker_frame import MarkerFrame
from .multi_target_session import MultiTargetSession

_LEAD = 10  # number of frames solved with known labels before the body is tracked in either direction
_LABELLED = 5  # number of the last of these frames, whose labels are used when tracking backwards
_FOLLOWED = 30  # number of frames after those with new labels that are solved again
_AGREEING = 5  # number of successive frames with equal labels that ends the backward tracking
_SAME_M = 0.005  # distance up to which two points are the same
_NEAR_M = 0.05  # largest movement of a marker between two frames
# evidence and costs are log likelihood ratios, nats
_ALIKE_S = 0.05  # period in which frames count as one piece of evidence
_EXCHANGE_COST = 4.0  # cost of each point that is another marker's in the next frame
_CLEAR = 1.0  # evidence needed to use the later labels
_HOPELESS = 30.0  # loss of evidence that ends the backward tracking
_LATER = PoseNote.of(NoteKind.LABELLED_LATER)


def relabel(
    frames: Sequence[MarkerFrame],
    poses: Sequence[ScenePose],
    begun: Sequence[int],
    session: MultiTargetSession,
    progress: Callable[[float], None],
) -> tuple[list[ScenePose], Mask]:
    """Return the poses, some solved with labels from later frames, and a mask (F,) of those.

    Args:
        poses: Live poses of the frames.
        begun: Ascending indices of the frames at which the session found or replaced labels.
        session: Session that solved the poses; it is reset.
        progress: Called with the fraction done.
    """
    result, changed = list(poses), np.zeros(len(frames), dtype=bool)
    confidence = np.array([[performer.confidence for performer in pose.performers] for pose in poses])
    most = np.ones_like(confidence)
    for at, stop in pairwise([*begun, len(frames)]):
        progress(at / len(frames))
        found, start = _follow_back(frames, result, at, min(at + _LEAD, stop), session)
        result[start : start + len(found)] = found
        changed[start : start + len(found)] = True
        most[start if found else at : stop] = confidence[at:stop].max(axis=0)
    for start, stop in runs(changed):
        _solve_again(frames, result, (start, stop), most, session)
    return result, changed


def _follow_back(
    frames: Sequence[MarkerFrame], poses: Sequence[ScenePose], at: int, stop: int, session: MultiTargetSession
) -> tuple[list[ScenePose], int]:
    """Return poses tracked backwards with the labels of the frames `at` to `stop`, and the index of the first."""
    session.reset()
    first = max(stop - _LABELLED, at)
    for index in range(stop - 1, first - 1, -1):
        session.step_labelled(_mirrored(frames[index]), poses[index])
    found: list[ScenePose] = []
    evidence, best, kept, agreeing, after = 0.0, _CLEAR, 0, 0, poses[first]
    for index in range(first - 1, -1, -1):
        present, pose = poses[index], session.step(_mirrored(frames[index]), check_labels=False)
        gain = session.label_cost(frames[index], present) - session.label_cost(frames[index], pose)
        if index >= at and gain <= 0.0:
            pose, gain = present, 0.0
        found.append(pose)
        evidence += gain * min(abs(pose.time_s - after.time_s) / _ALIKE_S, 1.0)
        evidence += _exchange_cost(present, poses[index + 1]) - _exchange_cost(pose, after)
        total = evidence
        if index > 0:
            total += _exchange_cost(poses[index - 1], present) - _exchange_cost(poses[index - 1], pose)
        if total > best and index < at:
            best, kept = total, len(found)
        agreeing = agreeing + 1 if index < at and _agree(pose, present) else 0
        if agreeing == _AGREEING or total < max(best, 0.0) - _HOPELESS:
            break
        after = pose
    return found[:kept][::-1], first - kept


def _solve_again(
    frames: Sequence[MarkerFrame],
    poses: list[ScenePose],
    relabelled: tuple[int, int],
    most: Array,
    session: MultiTargetSession,
) -> None:
    """Solve the relabelled frames, and some frames after them, again with their labels, in place.

    Args:
        most: Upper bound (F, P) on the confidence: the largest in the frames for which the labels were found.
    """
    session.reset()
    start, stop = relabelled
    for index in range(max(start - _LEAD, 0), min(stop + _FOLLOWED, len(frames))):
        pose = session.step_labelled(frames[index], poses[index])
        if index >= start:
            later = (_LATER,) if index < stop else ()
            performers = tuple(
                replace(performer, confidence=min(performer.confidence, limit), notes=(*performer.notes, *later))
                for performer, limit in zip(pose.performers, most[index].tolist(), strict=True)
            )
            poses[index] = replace(pose, performers=performers)


def _mirrored(frame: MarkerFrame) -> MarkerFrame:
    return replace(frame, time_s=-frame.time_s)


def _agree(pose: ScenePose, other: ScenePose) -> bool:
    """Return whether most points have the same label in both poses and none has different labels."""
    return all(map(_labels_agree, pose.performers, other.performers))


def _labels_agree(pose: PerformerPose, other: PerformerPose) -> bool:
    same = np.linalg.norm(pose.observed_m[:, None] - other.observed_m, axis=2) < _SAME_M
    fewest = min(np.sum(np.isfinite(each.observed_m[:, 0])) for each in (pose, other))
    return bool(2 * np.trace(same) >= fewest) and not np.any(same & ~np.eye(len(same), dtype=bool))


def _exchange_cost(pose: ScenePose, later: ScenePose) -> float:
    """Return the cost of points that belong to another marker in the next frame."""
    count = 0
    for before, after in zip(pose.performers, later.performers, strict=True):
        away = np.linalg.norm(before.observed_m[:, None] - after.observed_m, axis=2)
        away[~(away < _NEAR_M)] = _NEAR_M
        count += int(np.sum(away.min(axis=1) < away.diagonal()))
    return _EXCHANGE_COST * count
