"""Common parts of boxers and swordsmen: a stance that moves within the space, and the end of a bout."""

import numpy as np

from .feet import Swing
from .proportions import facing_front
from .timeline import Timeline

_LEG_M = 0.85  # length of the leg for which lengths of stances are given
LEAVE_S = 1.4  # time for leaving the guard
SHORT_S = 6.0  # a shorter bout begins with typical moves


class Fighter:
    """Writes a fighter's keys to a timeline.

    Attributes:
        size: Size of the body as a factor for lengths.
        spot: Ground point (x, z) of the stance, metres.
        heading: Direction of the stance, radians.
    """

    def __init__(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self.size = timeline.body.leg_m / _LEG_M
        self.spot = timeline.spot
        self.heading = facing_front(timeline.heading_rad)

    def move_spot(self, forward: float, left: float, low: tuple[float, float], high: tuple[float, float]) -> None:
        """Move the stance, within limits (x, z)."""
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        x = self.spot[0] + self.size * (left * cosine + forward * sine)
        z = self.spot[1] + self.size * (forward * cosine - left * sine)
        self.spot = (float(np.clip(x, low[0], high[0])), float(np.clip(z, low[1], high[1])))

    def feet_together(self, start_s: float, heels_up: dict[str, float], height: float, after_s: float) -> None:
        """Step back to stand square, and end the behaviour.

        Args:
            heels_up: Largest pitch of each foot, in the order of the steps.
            height: Height of the steps.
            after_s: Time after the last step.
        """
        timeline, lift = self.timeline, start_s + 0.25
        x, z = timeline.spot
        for side, heel_up in heels_up.items():
            to = timeline.placement(side, x, z, self.heading)
            timeline.step(side, Swing(lift, lift + 0.34, to, height * self.size), heel_up_rad=heel_up)
            lift += 0.42
        timeline.time_s = lift + after_s

    def hang_arms(self, time_s: float) -> None:
        """Key everything except the feet to a relaxed posture."""
        ease = self.timeline.at_ease()
        self.timeline.set(time_s, **{name: value for name, value in ease.items() if ".pitch" not in name})
