"""Walking and running within the small space that two cameras see."""

import numpy as np

from .curves import Track
from .gait import RUN, WALK, stepped, styled
from .proportions import facing_front
from .timeline import Timeline

_ROOM_X_M, _ROOM_Z_M = 0.55, 0.95  # half the size of the space to which the performer keeps
_SPEED_UP_S = 0.9
_LEG_M = 0.85  # length of the leg for which speeds are given


class _Way:
    """A path under construction: ground point, heading, time."""

    def __init__(self, timeline: Timeline) -> None:
        self.track, self.time_s = Track(), timeline.time_s
        self.to(0.0, *timeline.spot, timeline.heading_rad)

    def to(self, duration_s: float, x_m: float, z_m: float, heading_rad: float) -> None:
        """Continue to a position and heading within a time."""
        self.time_s += duration_s
        self.x_m, self.z_m, self.heading_rad = x_m, z_m, heading_rad
        self.track.key(self.time_s, (x_m, z_m, heading_rad))

    def travel(self, speed_m_s: float, x_m: float, z_m: float, heading_rad: float, lead_rad: float = 0.0) -> None:
        """Walk straight to a position: speed up, keep the speed, slow down; on the way turn aside by `lead_rad`."""
        x, z, heading = self.x_m, self.z_m, self.heading_rad
        distance = float(np.hypot(x_m - x, z_m - z))
        ramp = min(0.25 * speed_m_s * _SPEED_UP_S / max(distance, 1e-6), 0.3)
        cruise_s = max(distance / speed_m_s - 0.5 * _SPEED_UP_S, 0.3)
        ramp_s = 0.6 * _SPEED_UP_S
        for seconds, share, lead in (
            (ramp_s, ramp, 0.5), (0.5 * cruise_s, 0.5, 1.0), (0.5 * cruise_s, 1.0 - ramp, 0.5), (ramp_s, 1.0, 0.0)
        ):  # fmt: skip
            facing = heading + share * (heading_rad - heading) + lead * lead_rad
            self.to(seconds, x + share * (x_m - x), z + share * (z_m - z), facing)


def walk(timeline: Timeline, seconds: float) -> None:
    """Walk back and forth, mostly facing the cameras: forwards, backwards, sideways, round and in place."""
    end = timeline.time_s + seconds
    while end - timeline.time_s > 1.6:
        gait, way = styled(WALK, timeline), _Way(timeline)
        while way.time_s < end - 1.5:
            _walk_leg(timeline, way, end - way.time_s)
        stepped(timeline, gait, way.track, way.time_s)


def run(timeline: Timeline, seconds: float) -> None:
    """Run on the spot with short runs forward and backward."""
    end = timeline.time_s + seconds
    while end - timeline.time_s > 1.6:
        gait, way = styled(RUN, timeline), _Way(timeline)
        while way.time_s < end - 1.0:
            _run_leg(timeline, way)
        stepped(timeline, gait, way.track, min(way.time_s, end))


def _speed(timeline: Timeline, usual_m_s: float) -> float:
    style = timeline.style
    return timeline.vary(usual_m_s, 0.06) * style.amplitude * style.tempo * timeline.body.leg_m / _LEG_M


def _walk_leg(timeline: Timeline, way: _Way, left_s: float) -> None:
    uniform = timeline.rng.uniform
    speed = _speed(timeline, 1.08)
    near, far = way.z_m > 0.25, way.z_m < -0.25
    kinds = ["back", "sidle", "circle", "place", "round"] if near else ["advance", "advance", "circle", "sidle"]
    if not near and not far:
        kinds = ["advance", "back", "circle", "place", "sidle"]
    kind = kinds[timeline.one_of(len(kinds))]
    if kind == "circle" and (left_s < 5.5 or abs(way.z_m) > 0.5):
        kind = "back" if near else "advance"
    if kind == "round" and left_s < 6.0:
        kind = "back"
    if way.time_s == timeline.time_s and not near:
        kind = "advance"  # a walk starts forwards
    x = float(uniform(-_ROOM_X_M, _ROOM_X_M)) * 0.7
    z = _ROOM_Z_M * float(uniform(0.4, 1.0))
    front = facing_front(way.heading_rad)
    if kind == "advance":
        # someone who walks diagonally looks slightly towards the goal
        way.travel(speed, x, z, front, 0.5 * float(np.arctan2(x - way.x_m, max(z - way.z_m, 0.6))))
    elif kind == "back":
        way.travel(0.7 * speed, x, -z, front + timeline.jitter(0.1))
    elif kind == "sidle":
        x = way.x_m + (-0.5 if way.x_m > 0.0 else 0.5) * float(uniform(0.7, 1.1))
        way.travel(0.5 * speed, x, way.z_m, front + timeline.jitter(0.08))
    elif kind == "place":
        way.to(float(uniform(2.0, 3.0)), way.x_m, way.z_m, front + timeline.jitter(0.06))
    elif kind == "round":
        _there_and_back(timeline, way, speed)
    else:
        _circle(timeline, way, speed)


def _there_and_back(timeline: Timeline, way: _Way, speed: float) -> None:
    """Turn round, walk away from the cameras, turn again."""
    side = 1.0 if timeline.rng.random() < 0.5 else -1.0
    start = facing_front(way.heading_rad)
    away = start + side * np.pi
    home = start + (2.0 * side * np.pi if timeline.rng.random() < 0.5 else 0.0)
    turn_s = 1.25 / timeline.style.tempo
    way.to(turn_s, way.x_m + 0.15 * side, way.z_m - 0.05, 0.5 * (start + away))
    way.to(turn_s, way.x_m, way.z_m - 0.25, away)
    way.travel(speed, way.x_m - 0.2 * side, way.z_m - timeline.vary(0.9, 0.15), away)
    way.to(turn_s, way.x_m - 0.1 * side, way.z_m - 0.05, 0.5 * (away + home))
    way.to(turn_s, way.x_m, way.z_m + 0.15, home)


def _circle(timeline: Timeline, way: _Way, speed: float) -> None:
    """Walk a small circle and come back to face the cameras."""
    side = -float(np.sign(way.x_m + 0.25 * float(timeline.rng.uniform(-1.0, 1.0)) + 1e-9))
    radius = float(timeline.rng.uniform(0.50, 0.65))
    start_x, start_z, start = way.x_m, way.z_m, facing_front(way.heading_rad)
    count = 12
    lap_s = 2.0 * np.pi * radius / (0.75 * speed)
    way.to(0.5, way.x_m, way.z_m + 0.05, start)
    for i in range(1, count + 1):
        angle = 2.0 * np.pi * i / count
        x = start_x + side * radius * (1.0 - np.cos(angle))
        z = start_z + 0.05 + radius * np.sin(angle)
        way.to(lap_s / count, float(x), float(z), start + side * angle)
    way.to(0.6, way.x_m, way.z_m + 0.1, facing_front(way.heading_rad))


def _run_leg(timeline: Timeline, way: _Way) -> None:
    uniform = timeline.rng.uniform
    speed = _speed(timeline, 1.35)
    x = float(uniform(-0.3, 0.3))
    turn = facing_front(way.heading_rad) + timeline.jitter(0.15)
    if timeline.one_of(3) == 0:
        way.to(float(uniform(1.2, 2.2)), way.x_m + timeline.jitter(0.05), way.z_m + timeline.jitter(0.05), turn)
    elif way.z_m < 0.2:
        way.travel(speed, x, float(uniform(0.5, 0.9)), turn)
    else:
        way.travel(0.7 * speed, x, float(uniform(-0.9, -0.5)), turn)
