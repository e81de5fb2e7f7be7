"""Walking and running within the small space that two cameras see."""

from dataclasses import dataclass

import numpy as np

from .curves import Track
from .gait import RUN, WALK, stepped, styled
from .timeline import Timeline

_ROOM_X_M, _ROOM_Z_M = 0.55, 0.95  # half the space the performer keeps to
_SPEED_UP_S = 0.9
_LEG_M = 0.85  # leg of the body for which speeds are given


@dataclass
class _Way:
    """A path under construction: ground point, heading, time."""

    track: Track
    time_s: float
    x_m: float
    z_m: float
    heading_rad: float

    def to(self, duration_s: float, x_m: float, z_m: float, heading_rad: float) -> None:
        """Go on to a place and heading within a time."""
        self.time_s += duration_s
        self.x_m, self.z_m, self.heading_rad = x_m, z_m, heading_rad
        self.track.key(self.time_s, (x_m, z_m, heading_rad))

    def travel(self, speed_m_s: float, x_m: float, z_m: float, heading_rad: float, lead_rad: float = 0.0) -> None:
        """Go straight to a place: speed up, keep the speed, slow down.

        On the way turn aside by `lead_rad`.
        """
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

    @property
    def front_rad(self) -> float:
        """The heading that faces the cameras: whole turns so far are kept."""
        return float(2.0 * np.pi * np.round(self.heading_rad / (2.0 * np.pi)))


def _way(timeline: Timeline) -> _Way:
    x, z = timeline.spot
    way = _Way(Track(), timeline.time_s, x, z, timeline.heading_rad)
    way.track.key(way.time_s, (x, z, way.heading_rad))
    return way


def walk(timeline: Timeline, seconds: float) -> None:
    """Walk to and fro, mostly facing the cameras.

    Forwards, backwards, sideways, round and in place.
    """
    end = timeline.time_s + seconds
    while end - timeline.time_s > 1.6:
        gait = styled(WALK, timeline)
        way = _way(timeline)
        while way.time_s < end - 1.5:
            _walk_leg(timeline, way, end - way.time_s)
        stepped(timeline, gait, way.track, way.time_s)


def _walk_leg(timeline: Timeline, way: _Way, left_s: float) -> None:
    rng = timeline.rng
    speed = timeline.vary(1.08, 0.06) * timeline.style.amplitude * timeline.style.tempo * timeline.body.leg_m / _LEG_M
    near, far = way.z_m > 0.25, way.z_m < -0.25
    kinds = ["back", "sidle", "circle", "place", "round"] if near else ["advance", "advance", "circle", "sidle"]
    if not near and not far:
        kinds = ["advance", "back", "circle", "place", "sidle"]
    kind = kinds[int(rng.integers(len(kinds)))]
    if kind == "circle" and (left_s < 5.5 or abs(way.z_m) > 0.5):
        kind = "back" if near else "advance"
    if kind == "round" and left_s < 6.0:
        kind = "back"
    if way.time_s == timeline.time_s and not near:
        kind = "advance"  # who begins to walk walks forward
    x = float(rng.uniform(-_ROOM_X_M, _ROOM_X_M)) * 0.7
    z = _ROOM_Z_M * float(rng.uniform(0.4, 1.0))
    front = way.front_rad
    if kind == "advance":
        # who walks aslant looks where the way leads, a little
        lead = 0.5 * float(np.arctan2(x - way.x_m, max(z - way.z_m, 0.6)))
        way.travel(speed, x, z, front, lead)
    elif kind == "back":
        way.travel(0.7 * speed, x, -z, front + timeline.jitter(0.1))
    elif kind == "sidle":
        sideways = -0.5 if way.x_m > 0.0 else 0.5
        x = way.x_m + sideways * float(rng.uniform(0.7, 1.1))
        way.travel(0.5 * speed, x, way.z_m, front + timeline.jitter(0.08))
    elif kind == "place":
        way.to(float(rng.uniform(2.0, 3.0)), way.x_m, way.z_m, front + timeline.jitter(0.06))
    elif kind == "round":
        _there_and_back(timeline, way, speed)
    else:
        _circle(timeline, way, speed)


def _there_and_back(timeline: Timeline, way: _Way, speed: float) -> None:
    """Turn round, walk away from the cameras, turn again."""
    side = 1.0 if timeline.rng.random() < 0.5 else -1.0
    start, away = way.front_rad, way.front_rad + side * np.pi
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
    forward = 0.75 * speed
    start_x, start_z, start = way.x_m, way.z_m, way.front_rad
    count = 12
    lap_s = 2.0 * np.pi * radius / forward
    way.to(0.5, way.x_m, way.z_m + 0.05, start)
    for i in range(1, count + 1):
        angle = 2.0 * np.pi * i / count
        x = start_x + side * radius * (1.0 - np.cos(angle))
        z = start_z + 0.05 + radius * np.sin(angle)
        way.to(lap_s / count, float(x), float(z), start + side * angle)
    way.to(0.6, way.x_m, way.z_m + 0.1, way.front_rad)


def run(timeline: Timeline, seconds: float) -> None:
    """Run on the spot with short runs forward and backward."""
    end = timeline.time_s + seconds
    while end - timeline.time_s > 1.6:
        gait = styled(RUN, timeline)
        way = _way(timeline)
        while way.time_s < end - 1.0:
            _run_leg(timeline, way)
        stepped(timeline, gait, way.track, min(way.time_s, end))


def _run_leg(timeline: Timeline, way: _Way) -> None:
    rng = timeline.rng
    speed = timeline.vary(1.35, 0.06) * timeline.style.amplitude * timeline.style.tempo * timeline.body.leg_m / _LEG_M
    x = float(rng.uniform(-0.3, 0.3))
    turn = way.front_rad + timeline.jitter(0.15)
    if int(rng.integers(3)) == 0:
        way.to(float(rng.uniform(1.2, 2.2)), way.x_m + timeline.jitter(0.05), way.z_m + timeline.jitter(0.05), turn)
    elif way.z_m < 0.2:
        way.travel(speed, x, float(rng.uniform(0.5, 0.9)), turn)
    else:
        way.travel(0.7 * speed, x, float(rng.uniform(-0.9, -0.5)), turn)
