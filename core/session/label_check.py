"""Comparison of a tracked body's labels with alternative hypotheses, found without history."""

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from ..body.scene_pose import PerformerPose
from ..geometry.arrays import Array, IntArray, Mask
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.label_search import WORK, WORK_UNHURRIED, LabelSearch
from ..labelling.labeller import Labeller
from ..markers.marker_frame import MarkerFrame

_FIRST_S, _RARE_S = 0.03, 1.0  # first and longest pause between checks; the pause doubles while labels are certain
_SUSPECT_S = 0.1  # longest pause between checks of a suspect pose, and shortest between trials of alternatives
_SUSPECT = 0.5  # agreement, relative to the share of located markers, below which a pose is suspect
_STRAYS = 2  # number of unlabelled points, with as many hidden markers, that makes labels suspect
_TORSO_MARKERS = 2  # fewest located torso markers for a pose that is not suspect
_ENOUGH = 0.6  # share of the markers that must be located for a check
_SAME_M = 0.02  # distance up to which two points are the same
_UNCERTAIN = 0.3  # smallest factor by which uncertain labels scale a pose's confidence
_MISPLACED_M = 0.1  # scale on which the factor falls with the RMS distance between current and likely markers

# gains are log likelihood ratios of alternative to current labels, nats
_CERTAIN = -2.0  # best gain below which one check confirms the current labels
_UNCLEAR = -0.8  # best gain above which a check does not confirm them; between the two it confirms partly
_CONFIRMATIONS = 3.0  # sum of confirmations that makes the labels of a suspect pose certain; 1 for other poses
_BETTER = 1.0  # best gain above which the labels are uncertain again
_PLAUSIBLE = -4.0  # evidence needed to try alternative labels of a suspect pose
_NEARER = 0.7  # alternatives on trial are accepted if the distance to the closest example falls below this share
_LEAST = -10.0  # lower bound on the evidence for an alternative
_PROVEN = 5.0  # evidence that replaces labels if the closest example is no farther; gain that adds labels
_DECISIVE = 8.0  # gain that replaces labels unconditionally
_FOLLOWED = 10.0  # penalty for relabelling markers that were tracked confidently
_INDEPENDENT_S = 0.3  # time after which a check of such markers is independent of the last; an earlier one counts less
_GONE_S = 0.1  # time without a pose after which earlier checks no longer count

Renaming: TypeAlias = tuple[int, ...]  # see `LabelCheck._renaming`
_NEW = -2  # entry of a renaming for a marker whose alternative point has no label now


class Alternative(NamedTuple):
    """Alternative labels for the points of a search."""

    search: LabelSearch
    labels: IntArray  # (N,)
    renaming: Renaming
    nearer: float  # accepted if the distance to the closest example falls below this share of the current one
    contradicts: bool  # they relabel markers that were tracked confidently


class LabelCheck:
    """Judges how certain the labels of a tracked body are, and when alternative labels are more likely.

    Args:
        torso: Markers (M,) on the torso.
    """

    def __init__(self, initial: InitialLabeller, torso: Mask) -> None:
        self._initial, self._torso = initial, torso
        self._search: LabelSearch | None = None
        self._current_m, self._current_cost = np.empty((0, 3)), 0.0
        self._is_sure: Mask = np.zeros(0, dtype=bool)
        self._confirmed, self._was_suspect, self._were_certain = 0.0, False, False
        self._compared: Mask = np.ones(len(torso), dtype=bool)
        self._misplaced_m = np.inf  # RMS distance by which alternative labels that are likely would move the markers
        self._evidence: dict[Renaming, float] = {}
        self._contradicting: set[Renaming] = set()
        self._weighed_s, self._stepped_s = -np.inf, -np.inf
        self._tried: set[Renaming] = set()
        self._wait_s, self._checked_s, self._tried_s = _FIRST_S, -np.inf, -np.inf

    def begin(self, time_s: float, start: InitialLabels | None = None) -> None:
        """Initialise the confidence in new labels; if a search found them, it depends on the alternatives found."""
        self._checked_s, self._were_certain = time_s, False
        if start is not None:
            self._confirmed = _confirmation(max((start.cost - cost for _, cost in start.alternatives), default=-np.inf))

    @property
    def confirmed_markers(self) -> Mask:
        """Markers (M,) that were located in all frames since the last check, so that its result applies to them."""
        return self._compared

    def is_certain(self, frame: MarkerFrame, seen: Mask) -> bool:
        """Return whether there is no evidence against the labels.

        Args:
            seen: Markers (M,) that any camera sees.
        """
        return self._is_certain(self._was_suspect) and _strays(frame, seen) < _STRAYS

    def confidence(self, frame: MarkerFrame, seen: Mask) -> float:
        """Return the factor by which uncertain labels lower a pose's confidence; arguments are those of `is_certain`.

        The farther likely alternatives would move the markers, the lower the factor is: exchanging two adjacent markers
        hardly changes a pose.
        """
        if self.is_certain(frame, seen):
            return 1.0
        if _strays(frame, seen) >= _STRAYS:
            return _UNCERTAIN
        return float(_UNCERTAIN + (1.0 - _UNCERTAIN) * np.exp(-((self._misplaced_m / _MISPLACED_M) ** 2)))

    def step(
        self,
        frame: MarkerFrame,
        elapsed_s: float,
        pose: PerformerPose,
        agreement: float,
        is_confident: Mask,
        busy: bool = False,
    ) -> Alternative | None:
        """Return alternative labels if this frame makes any likely.

        Args:
            agreement: Agreement of the pose, see `tracking_quality.Fit`.
            is_confident: Markers (M,) that have been tracked confidently since the labels were last certain.
            busy: The frame was already expensive, so the search pauses.
        """
        self._compared = self._compared & np.isfinite(pose.observed_m[:, 0])
        if _GONE_S < pose.time_s - self._stepped_s < np.inf:
            self._confirmed = 0.0
        self._stepped_s = pose.time_s
        suspect = self._is_suspect(frame, pose, agreement)
        if self._search is not None:
            self._search.follow(frame.points_m, elapsed_s)
        elif self._is_due(frame, pose, suspect):
            self._search = LabelSearch(self._initial, frame.points_m, Labeller(self._torso))
            self._current_m, self._is_sure = pose.observed_m, is_confident
            ghosts = max(len(frame.points_m) - int(np.sum(np.isfinite(pose.observed_m[:, 0]))), 0)
            self._current_cost = self._initial.cost(pose.observed_m, pose.markers_m, ghosts)
        if self._search is None or busy or not self._search.advance(self._work(frame, pose, suspect)):
            return None
        search, self._search = self._search, None
        return self._judge(search, suspect, pose.time_s)

    def _is_suspect(self, frame: MarkerFrame, pose: PerformerPose, agreement: float) -> bool:
        """Return whether the pose or unlabelled points are evidence against the labels."""
        located = np.isfinite(pose.observed_m[:, 0])
        explained = agreement / max(np.mean(located), 1e-3)
        unseen = np.sum(located & self._torso) < _TORSO_MARKERS
        return bool(explained < _SUSPECT or unseen or _strays(frame, pose.seen) >= _STRAYS)

    def _work(self, frame: MarkerFrame, pose: PerformerPose, suspect: bool) -> float:
        """Return how much work the search does in this frame: less while there is no evidence against the labels."""
        is_certain = self._is_certain(suspect)
        self._were_certain |= is_certain
        likely = not self._were_certain or max(self._evidence.values(), default=0.0) >= 0.0
        unclear = not is_certain and likely
        return WORK if unclear or _strays(frame, pose.seen) else WORK_UNHURRIED

    def _is_due(self, frame: MarkerFrame, pose: PerformerPose, suspect: bool) -> bool:
        """Return whether to start a search now."""
        turned, self._was_suspect = suspect and not self._was_suspect, suspect
        if turned:
            self._confirmed = 0.0
        if not self._is_certain(suspect):
            self._wait_s = _FIRST_S
        waited_s = pose.time_s - self._checked_s
        if waited_s == 0.0 or (waited_s < self._wait_s and not turned):
            return False
        if len(frame.points_m) < _ENOUGH * len(self._torso):
            return False
        self._checked_s = pose.time_s
        self._wait_s = min(2.0 * self._wait_s, _SUSPECT_S if suspect else _RARE_S)
        return True

    def _is_certain(self, suspect: bool) -> bool:
        return self._confirmed >= (_CONFIRMATIONS if suspect else 1.0)

    def _judge(self, search: LabelSearch, suspect: bool, time_s: float) -> Alternative | None:
        """Weigh the labels that a search has found; return the likeliest alternative if it is likely enough."""
        current = tuple(range(len(self._torso)))
        found = [(self._renaming(labels, search.points_m), labels, cost) for labels, cost in search.labellings()]
        others = {
            renaming: (labels, self._current_cost - cost - _FOLLOWED * contradicts, contradicts)
            for renaming, labels, cost in reversed(found)
            if renaming != current
            for contradicts in (self._is_contradicted(renaming),)
        }
        gains = {renaming: gain for renaming, (_, gain, _) in others.items()}
        self._weigh(gains, {renaming for renaming, (_, _, contradicts) in others.items() if contradicts}, time_s)
        most = max(
            (self._evidence[other] if other in self._contradicting else gain for other, gain in gains.items()),
            default=-np.inf,
        )
        # a search that did not find the current labels does not confirm them
        is_found = any(renaming == current for renaming, _, _ in found)
        likely = [self._moved_m(search, labels) for labels, gain, _ in others.values() if gain > _CERTAIN]
        agrees = any(renaming == current or self._only_adds(renaming) for renaming, _, _ in found)
        self._misplaced_m = max(likely, default=0.0) if agrees else np.inf
        self._confirmed = self._confirmed + is_found * _confirmation(most) if most < _BETTER else 0.0
        self._compared = np.isfinite(self._current_m[:, 0])
        if not others or (most < 0.0 and not is_found):
            return None
        return self._chosen(search, others, suspect, time_s)

    def _chosen(
        self, search: LabelSearch, others: Mapping[Renaming, tuple[IntArray, float, bool]], suspect: bool, time_s: float
    ) -> Alternative | None:
        """Return the alternative with the most evidence if it is to replace the labels, or is worth a trial.

        Args:
            others: Labels (N,) and gain of each alternative, and whether it contradicts confident tracking.
        """
        gains = {renaming: gain for renaming, (_, gain, _) in others.items()}
        best = max(gains, key=lambda other: (self._evidence[other], gains[other]))
        # a gain from labelling an additional point is not evidence for relabelling the others
        added = [renaming for renaming in gains if self._only_adds(renaming)]
        if added and _NEW in best and gains[best] - max(map(gains.__getitem__, added)) < _PROVEN:
            best = max(added, key=gains.__getitem__)
        labels, gain, contradicts = others[best]
        names_more = np.sum(labels >= 0) > np.sum(np.isfinite(self._current_m[:, 0]))
        if gain > (_PROVEN if names_more else _DECISIVE):
            return Alternative(search, labels, best, np.inf, contradicts)
        is_better = self._evidence[best] > _PROVEN
        uncertain = suspect or not self._is_certain(suspect) or best not in self._tried
        is_plausible = uncertain and min(gain, self._evidence[best]) > _PLAUSIBLE
        if not (is_better or is_plausible) or time_s - self._tried_s < _SUSPECT_S:
            return None
        self._tried_s = time_s
        self._tried.add(best)
        return Alternative(search, labels, best, 1.0 if is_better else _NEARER, contradicts)

    def put_off(self, alternative: Renaming) -> None:
        """Treat the current labels as uncertain, because the alternative ones could not be tried yet."""
        self._confirmed, self._tried_s = 0.0, -np.inf
        self._tried.discard(alternative)

    def refute(self, alternative: Renaming) -> None:
        """Lower the evidence for an alternative that does not fit the body."""
        self._evidence[alternative] = _LEAST

    def _weigh(self, gains: Mapping[Renaming, float], contradicting: set[Renaming], time_s: float) -> None:
        """Add the gains of a check to the evidence for each renaming.

        The penalty for relabelling confidently tracked markers counts only once, however long the body stays in an
        ambiguous pose.
        """
        share, self._weighed_s = min((time_s - self._weighed_s) / _INDEPENDENT_S, 1.0), time_s
        sums = {}
        for other, gain in gains.items():
            before = self._evidence.get(other, 0.0)
            if other not in contradicting:
                sums[other] = before + gain
            elif other in self._contradicting:
                sums[other] = before + share * (gain + _FOLLOWED)
            else:
                sums[other] = gain
        least = min(0.0, *gains.values()) if gains else 0.0
        sums |= {other: before + least for other, before in self._evidence.items() if other not in gains}
        self._evidence = {
            other: max(value, _LEAST) for other, value in sums.items() if other in gains or value > _LEAST
        }
        self._contradicting = contradicting | (self._contradicting & (self._evidence.keys() - gains.keys()))

    def _renaming(self, labels: IntArray, points_m: Array) -> Renaming:
        """Return which marker now has the point that labels give to each; -1 for no point, `_NEW` if unlabelled."""
        other = np.full(self._current_m.shape, np.nan)
        other[labels[labels >= 0]] = points_m[labels >= 0]
        near = np.linalg.norm(other[:, None] - self._current_m[None], axis=-1) < _SAME_M
        seen = np.isfinite(other[:, 0])
        names = np.where(near.any(axis=1), near.argmax(axis=1), np.where(seen, _NEW, -1))
        hidden = ~seen & ~np.isfinite(self._current_m[:, 0])
        return tuple(np.where(hidden, np.arange(len(names)), names).tolist())

    def _moved_m(self, search: LabelSearch, labels: IntArray) -> float:
        """Return the RMS distance by which labels (N,) move the markers that both locate; infinity without any."""
        other = np.full(self._current_m.shape, np.nan)
        other[labels[labels >= 0]] = search.points_m[labels >= 0]
        squares = np.sum((other - self._current_m) ** 2, axis=1)
        known = squares[np.isfinite(squares)]
        return float(np.sqrt(np.mean(known))) if len(known) else np.inf

    def _only_adds(self, renaming: Renaming) -> bool:
        """Return whether a renaming keeps all current labels and only adds labels."""
        located = np.isfinite(self._current_m[:, 0])
        return all(before == marker or (before < 0 and not located[marker]) for marker, before in enumerate(renaming))

    def _is_contradicted(self, renaming: Renaming) -> bool:
        """Return whether a renaming takes the point of a confidently tracked marker away."""
        followed = np.flatnonzero(self._is_sure & np.isfinite(self._current_m[:, 0]))
        return any(
            renaming[marker] not in (marker, -1) or (renaming[marker] == -1 and marker in renaming)
            for marker in followed.tolist()
        )


def _confirmation(gain: float) -> float:
    """Return how far a check whose best alternative has this gain confirms the current labels, 0 to 1."""
    return float(np.clip((_UNCLEAR - gain) / (_UNCLEAR - _CERTAIN), 0.0, 1.0))


def _strays(frame: MarkerFrame, seen: Mask) -> int:
    """Return the number of unlabelled points, at most that of the markers that no camera sees (`seen`: (M,))."""
    return min(len(frame.points_m), len(seen)) - int(np.count_nonzero(seen))
