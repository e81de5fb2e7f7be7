"""Entry points of the simulated performer: one behaviour, or a sequence."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.simulate.performance import T_POSE_S

from .bodies import body
from .boxing import box
from .kendo import fence
from .leaping import hop, jump
from .motion_synthesis import synthesise_motion
from .proportions import SIDES, Body
from .style import Style
from .timeline import STANDING_HEIGHT, Timeline
from .walking import run, walk

BEHAVIOURS: dict[str, Callable[[Timeline, float], None]] = {
    "walking": walk,
    "running": run,
    "hopping": hop,
    "jumping": jump,
    "boxing": box,
    "kendo": fence,
}

# shares of the demo's time, the first ones first where it is short
_DEMO_SHARES = {"walking": 3.6, "boxing": 5.0, "jumping": 3.2, "kendo": 4.8, "running": 3.2, "hopping": 3.2}
_SHORTEST_S = 3.2  # of a behaviour in the demo
_LEAST_S = 2.0  # of a behaviour
_END_S = 1.2
ARMS_DOWN_S = 0.9
DEMO_STREAM = 1_000_000  # seeds from here on are the demo's, those below the database's


def perform(
    behaviour: str,
    seconds: float,
    fps: float = 60.0,
    skeleton: Skeleton | None = None,
    style: Style | None = None,
    seed: int = 0,
) -> Motion:
    """Return one behaviour, from standing at ease to standing at ease again.

    Args:
        behaviour: one of `BEHAVIOURS`.
        seconds: length of the motion; the same seed gives the same motion.
        skeleton: the performer's body (a standard skeleton); the default one without.
        style: manner of moving; ordinary without.

    Raises:
        SettingsError: unknown behaviour, too short a time.
    """
    timeline = _new_score(skeleton, style, seed)
    _act(timeline, behaviour, seconds - 0.8)
    rest(timeline, max(seconds - timeline.time_s, 0.8))
    return _cut(synthesise_motion(timeline, fps, f"{behaviour}-{timeline.style.name}-{seed}"), seconds)


def performance(
    script: Sequence[tuple[str, float]],
    fps: float = 60.0,
    skeleton: Skeleton | None = None,
    style: Style | None = None,
    seed: int = 0,
    name: str = "performance",
) -> Motion:
    """Return a sequence: T pose for two seconds, arms down, the script, standing.

    Args:
        script: (behaviour, seconds) in order; "rest" stands at ease.
        fps, skeleton, style, seed: as in `perform`.
    """
    for behaviour, seconds in script:
        if seconds < _LEAST_S and behaviour != "rest":
            raise _too_short(behaviour, seconds)
    timeline = _new_score(skeleton, style, seed)
    _t_pose(timeline)
    end_s = timeline.time_s
    for behaviour, seconds in script:
        end_s += seconds
        left_s = end_s - timeline.time_s  # what one behaviour leaves over the next one takes
        if behaviour == "rest":
            rest(timeline, max(left_s, 0.5))
        else:
            _act(timeline, behaviour, max(left_s, _LEAST_S))
    rest(timeline, _END_S)
    return synthesise_motion(timeline, fps, name)


def demo_performance(
    seed: int = 0, seconds: float = 24.0, fps: float = 60.0, skeleton: Skeleton | None = None
) -> Motion:
    """Return the demo's performance: T pose, then behaviours that fit into the time.

    Its random numbers are from a stream that the embedded motion database does not use: like motion, but not the same.

    Raises:
        SettingsError: not even one behaviour fits into the time.
    """
    free_s = seconds - T_POSE_S - ARMS_DOWN_S - _END_S
    if free_s < _SHORTEST_S:
        least = seconds - free_s + _SHORTEST_S
        raise SettingsError(f"a demo of {seconds:.1f} s is too short", advice=f"give it {least:.1f} s or more")
    chosen = list(_DEMO_SHARES)[: max(1, int(free_s / _SHORTEST_S))]
    whole = sum(_DEMO_SHARES[name] for name in chosen)
    script = [(name, free_s * _DEMO_SHARES[name] / whole) for name in BEHAVIOURS if name in chosen]
    person = skeleton if skeleton is not None else body(1.78, 0.2, DEMO_STREAM)
    style = Style("demo", tempo=1.03, amplitude=1.04, arm_swing=1.1, asymmetry=0.05)
    return performance(script, fps, person, style, DEMO_STREAM + seed, "demo")


def _new_score(skeleton: Skeleton | None, style: Style | None, seed: int) -> Timeline:
    body = Body(skeleton if skeleton is not None else default_skeleton())
    return Timeline(body, style or Style(), np.random.default_rng(seed))


def _act(timeline: Timeline, behaviour: str, seconds: float) -> None:
    if behaviour not in BEHAVIOURS:
        raise SettingsError(f"there is no behaviour {behaviour!r}", advice="behaviours: " + ", ".join(BEHAVIOURS))
    if seconds < _LEAST_S:
        raise _too_short(behaviour, seconds)
    BEHAVIOURS[behaviour](timeline, seconds)


def _too_short(behaviour: str, seconds: float) -> SettingsError:
    return SettingsError(f"{behaviour} for {seconds:.1f} s is too short", advice="give it 3 s or more")


def _cut(motion: Motion, seconds: float) -> Motion:
    return sliced(motion, 0, round(seconds * motion.fps) + 1)


def rest(timeline: Timeline, seconds: float) -> None:
    """Come to stand at ease and stay so."""
    start = timeline.time_s
    timeline.anchor(start)
    settle = min(0.7, 0.8 * seconds)
    timeline.set(start + settle, height=timeline.body.standing_m * STANDING_HEIGHT, **timeline.at_ease())
    timeline.time_s = start + seconds
    timeline.anchor(timeline.time_s)


def _t_pose(timeline: Timeline) -> None:
    """Stand in the T pose for `T_POSE_S`, then let the arms sink."""
    straight: dict[str, ArrayLike] = {}
    for side in SIDES:
        straight |= {
            f"{side}.arm": (0.0, np.pi / 2.0, -np.pi / 6.0),
            f"{side}.elbow": 0.0,
            f"{side}.hand": (0.0, 0.0, 0.0),
            f"{side}.grip": 0.0,
        }
    upright: dict[str, ArrayLike] = {"spine": (0.0, 0.0, 0.0), "head": (0.0, 0.0, 0.0), "pelvis": (0.0, 0.0, 0.0)}
    for time_s in (0.0, T_POSE_S):
        timeline.set(time_s, height=timeline.body.standing_m, **straight, **upright)
    timeline.natural_from_s = T_POSE_S
    timeline.time_s = T_POSE_S + ARMS_DOWN_S
    timeline.set(timeline.time_s, height=timeline.body.standing_m * STANDING_HEIGHT, **timeline.at_ease())
    timeline.anchor(timeline.time_s)
