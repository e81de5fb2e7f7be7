"""Text about the passages of a take in which poses are doubtful, or a target was not found, for people."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from ..body.pose_notes import PoseNote
from ..body.scene_pose import DoubtfulStretch, PerformerPose, ScenePose, doubtful_stretches
from ..geometry.arrays import Array, Mask, runs


@dataclass(frozen=True)
class DoubtfulTextSettings:
    """Limits for the passages that are listed, chosen so that the text stays readable."""

    joined_s: float = 0.25  # longest pause between passages that are listed as one
    shortest_s: float = 0.1  # shortest passage that is listed; the eye hardly notices shorter ones
    listed: int = 4  # largest number of passages in the text


_S = DoubtfulTextSettings()
_NOT_FOUND = "not found"


def doubtful_text(poses: Sequence[ScenePose], performers: Sequence[str], props: Sequence[str], frames: Array) -> str:
    """Return where poses are doubtful or a target was not found, and why: "right hand, frames 40 to 62 (...)".

    Args:
        performers: Name of each performer; left out of the text if there is only one.
        props: Name of each prop.
        frames: Frame of each pose (F,), as the reader counts them.

    Returns:
        The longest passages in order of time; "" if nothing is doubtful.
    """
    found: list[tuple[DoubtfulStretch, str]] = []
    missing = []
    for index, name in enumerate(performers):
        own = [_with_own_notes(pose, index, performers, props) for pose in poses]
        seen = np.array([pose.confidence > 0.0 for pose in own], dtype=np.bool_)
        if not seen.any():
            missing.append(name)
            continue
        prefix = f"{name}: " if len(performers) > 1 else ""
        found += [(each, prefix + (each.part or "whole body")) for each in _joined(doubtful_stretches(own))]
    for index, name in enumerate(props):
        seen = np.array([pose.props[index].found for pose in poses], dtype=np.bool_)
        if not seen.any():
            missing.append(name)
            continue
        found += [(each, name) for each in _joined(_not_found(poses, ~seen))]
    told = [f"{name} was never found" for name in missing]
    longest = sorted(found, key=lambda row: row[0].start_s - row[0].stop_s)
    shown = [row for row in longest[: _S.listed] if row[0].stop_s - row[0].start_s >= _S.shortest_s]
    told += _passage_texts(sorted(shown, key=lambda row: row[0].start_s), frames)
    if len(found) > len(shown) > 0:
        told.append(f"{len(found) - len(shown)} shorter")
    return "; ".join(told)


def _with_own_notes(pose: ScenePose, index: int, performers: Sequence[str], props: Sequence[str]) -> PerformerPose:
    """Return a performer's pose with the notes about this performer among those of the whole scene."""
    prefixes = [f"{name}: " for name in performers]
    texts = [note.text for note in pose.notes]
    if index:
        own = [text.removeprefix(prefixes[index]) for text in texts if text.startswith(prefixes[index])]
    else:
        others = (*prefixes[1:], *(f"{name} hidden" for name in props))
        own = [text for text in texts if not text.startswith(others)]
    return replace(pose.performers[index], notes=tuple(map(PoseNote.of_text, own)))


def _passage_texts(passages: Sequence[tuple[DoubtfulStretch, str]], frames: Array) -> list[str]:
    """Return a text for each passage; a reason that all of them have stands once, at the end."""
    reasons = [passage.reason.removeprefix(f"{passage.part} uncertain: ") for passage, _ in passages]
    texts = [f"{what}, frames {frames[each.first]:.0f} to {frames[each.last]:.0f}" for each, what in passages]
    if len(reasons) > 1 and reasons[0] and len(set(reasons)) == 1:
        reasons = [*[""] * (len(reasons) - 1), f"each: {reasons[0]}"]
    return [f"{text} ({reason})" if reason else text for text, reason in zip(texts, reasons, strict=True)]


def _not_found(poses: Sequence[ScenePose], missing: Mask) -> list[DoubtfulStretch]:
    """Return the passages in which a prop was not found."""
    times_s = [pose.time_s - poses[0].time_s for pose in poses]
    return [
        DoubtfulStretch(times_s[start], times_s[stop - 1], _NOT_FOUND, "", start, stop - 1)
        for start, stop in runs(missing)
    ]


def _joined(stretches: Sequence[DoubtfulStretch]) -> Iterator[DoubtfulStretch]:
    """Yield the stretches of each part; those with a short pause between them become one, with the longest's reason."""
    for _, of_part in groupby(stretches, key=lambda stretch: stretch.part):
        group: list[DoubtfulStretch] = []
        for stretch in of_part:
            if group and stretch.start_s - group[-1].stop_s > _S.joined_s:
                yield _one(group)
                group = []
            group.append(stretch)
        yield _one(group)


def _one(group: Sequence[DoubtfulStretch]) -> DoubtfulStretch:
    main = max(group, key=lambda stretch: (bool(stretch.reason), stretch.stop_s - stretch.start_s))
    first, last = group[0], group[-1]
    return replace(main, start_s=first.start_s, stop_s=last.stop_s, first=first.first, last=last.last)
