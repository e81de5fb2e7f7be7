"""Entry points of the simulated performer: one behaviour, or a sequence."""

from collections.abc import Callable, Sequence

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.simulate.shipped_performance import T_POSE_S

from .bodies import body
from .boxing import box
from .kendo import fence
from .leaping import hop, jump
from .motion_synthesis import synthesise_motion
from .proportions import SIDES, Body
from .style import Style
from .timeline import Timeline
from .walking import run, walk

BEHAVIOURS: dict[str, Callable[[Timeline, float], None]] = {
    "walking": walk, "running": run, "hopping": hop, "jumping": jump, "boxing": box, "kendo": fence,
}  # fmt: skip

# relative durations of the behaviours in the demo
_DEMO_SHARES = {"walking": 3.6, "boxing": 5.0, "jumping": 3.2, "kendo": 4.8, "running": 3.2}
_END_S = 1.2
ARMS_DOWN_S = 0.9
DEMO_STREAM = 1_000_000  # seeds from here on are the demo's, lower ones the database's


def perform(
    behaviour: str,
    seconds: float,
    fps: float = 60.0,
    skeleton: Skeleton | None = None,
    style: Style | None = None,
    seed: int = 0,
) -> Motion:
    """Return one behaviour, starting and ending relaxed and standing.

    Args:
        behaviour: One of `BEHAVIOURS`.
        seconds: Length of the motion, 3 or more.
        skeleton: Standard skeleton of the performer's body; by default an average one.
        style: Manner of moving; by default an ordinary one.
        seed: Seed for everything that varies.
    """
    timeline = _timeline(skeleton, style, seed)
    BEHAVIOURS[behaviour](timeline, seconds - 0.8)
    rest(timeline, max(seconds - timeline.time_s, 0.8))
    motion = synthesise_motion(timeline, fps, f"{behaviour}-{timeline.style.name}-{seed}")
    return sliced(motion, 0, round(seconds * fps) + 1)


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
        script: Behaviours and their durations (2 s or more) in order; "rest" stands relaxed.
        fps, skeleton, style, seed: As in `perform`.
        name: Name of the motion.
    """
    timeline = _timeline(skeleton, style, seed)
    _t_pose(timeline)
    end_s = timeline.time_s
    for behaviour, seconds in script:
        end_s += seconds
        left_s = end_s - timeline.time_s  # time that one behaviour leaves over is given to the next
        if behaviour == "rest":
            rest(timeline, max(left_s, 0.5))
        else:
            BEHAVIOURS[behaviour](timeline, max(left_s, 2.0))
    rest(timeline, _END_S)
    return synthesise_motion(timeline, fps, name)


def demo_performance(seconds: float) -> Motion:
    """Return the demo's performance: T pose, then the behaviours that fit into the time.

    Its random numbers come from a stream that the embedded motion database does not use: similar motion, but not the
    """
    free_s = seconds - T_POSE_S - ARMS_DOWN_S - _END_S
    script = [
        (name, free_s * _DEMO_SHARES[name] / sum(_DEMO_SHARES.values())) for name in BEHAVIOURS if name in _DEMO_SHARES
    ]
    style = Style("demo", tempo=1.03, amplitude=1.04, arm_swing=1.1, asymmetry=0.05)
    return performance(script, 60.0, body(1.78, 0.2, DEMO_STREAM), style, DEMO_STREAM, "demo")


def _timeline(skeleton: Skeleton | None, style: Style | None, seed: int) -> Timeline:
    return Timeline(Body(skeleton or default_skeleton()), style or Style(), np.random.default_rng(seed))


def rest(timeline: Timeline, seconds: float) -> None:
    """Come to a relaxed stand and hold it."""
    start = timeline.time_s
    timeline.anchor(start)
    timeline.stand(start + min(0.7, 0.8 * seconds))
    timeline.time_s = start + seconds
    timeline.anchor(timeline.time_s)


def _t_pose(timeline: Timeline) -> None:
    """Stand in the T pose for `T_POSE_S`, then lower the arms."""
    level = (0.0, 0.0, 0.0)
    for time_s in (0.0, T_POSE_S):
        timeline.set(time_s, height=timeline.body.standing_m, spine=level, head=level, pelvis=level)
        for side in SIDES:
            timeline.set_side(side, time_s, arm=(0.0, np.pi / 2.0, -np.pi / 6.0), elbow=0.0, hand=level, grip=0.0)
    timeline.natural_from_s = T_POSE_S
    timeline.time_s = T_POSE_S + ARMS_DOWN_S
    timeline.stand(timeline.time_s)
    timeline.anchor(timeline.time_s)
