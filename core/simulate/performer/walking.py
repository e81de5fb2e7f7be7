"""Walking and running within the small space that two cameras see."""

from dataclasses import dataclass

import numpy as np

from .curves import Track
from .gait import RUN, WALK, Gait, stepped, styled
from .score import Score

_ROOM_X_M, _ROOM_Z_M = 0.55, 0.95  # half the space the performer keeps to


@dataclass
class _Way:
    """A path that is being laid: ground point, heading, time."""

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

    @property
    def front_rad(self) -> float:
        """The heading that faces the cameras: whole turns so far are kept."""
        return float(2.0 * np.pi * np.round(self.heading_rad / (2.0 * np.pi)))


def _way(score: Score) -> _Way:
    x, z = score.spot
    way = _Way(Track(), score.time_s, x, z, score.heading_rad)
    way.track.key(way.time_s, (x, z, way.heading_rad))
    return way


def walk(score: Score, seconds: float) -> None:
    """Walk to and fro, mostly facing the cameras: forwards, backwards, sideways, round and in place."""
    end = score.time_s + seconds
    while end - score.time_s > 1.6:
        gait = styled(WALK, score)
        way = _way(score)
        while way.time_s < end - 1.5:
            _walk_leg(score, way, gait, end - way.time_s)
        stepped(score, gait, way.track, way.time_s)


def _walk_leg(score: Score, way: _Way, gait: Gait, left_s: float) -> None:
    rng = score.rng
    speed = 1.12 * score.style.amplitude * score.style.tempo * score.body.leg_m / 0.85
    near, far = way.z_m > 0.25, way.z_m < -0.25
    kinds = ["back", "sidle", "circle", "place", "round"] if near else ["advance", "advance", "circle", "sidle"]
    if not near and not far:
        kinds = ["advance", "back", "circle", "place", "sidle", "round"]
    kind = kinds[int(rng.integers(len(kinds)))]
    if kind == "circle" and left_s < 6.0:
        kind = "back" if near else "advance"
    if kind == "round" and left_s < 7.0:
        kind = "back" if way.z_m > -0.3 else "advance"
    x = float(rng.uniform(-_ROOM_X_M, _ROOM_X_M)) * 0.7
    if kind == "advance":
        z = _ROOM_Z_M * float(rng.uniform(0.8, 1.0))
        _straight(way, x, z, speed, way.front_rad)
    elif kind == "back":
        _straight(way, x, -_ROOM_Z_M * float(rng.uniform(0.8, 1.0)), 0.7 * speed, way.front_rad + score.jitter(0.1))
    elif kind == "sidle":
        sideways = -0.5 if way.x_m > 0.0 else 0.5
        x = way.x_m + sideways * float(rng.uniform(0.7, 1.1))
        _straight(way, x, way.z_m, 0.5 * speed, way.front_rad + score.jitter(0.08))
    elif kind == "place":
        way.to(float(rng.uniform(2.0, 3.0)), way.x_m, way.z_m, way.front_rad + score.jitter(0.06))
    elif kind == "round":
        _there_and_back(score, way, speed)
    else:
        _circle(score, way, speed)


def _straight(way: _Way, x_m: float, z_m: float, speed_m_s: float, turn_rad: float) -> None:
    distance = float(np.hypot(x_m - way.x_m, z_m - way.z_m))
    # who walks forward looks where the way leads, a little
    lead = 0.5 * float(np.arctan2(x_m - way.x_m, max(z_m - way.z_m, 0.6))) if z_m > way.z_m + 0.6 else 0.0
    if abs(lead) > 0.02 and distance > 0.8:
        share = 0.4
        way.to(
            share * distance / speed_m_s + 0.4,
            way.x_m + share * (x_m - way.x_m), way.z_m + share * (z_m - way.z_m), lead + turn_rad,
        )  # fmt: skip
        distance *= 1.0 - share
        way.to(distance / speed_m_s + 0.4, x_m, z_m, turn_rad)
        return
    way.to(max(distance / speed_m_s + 0.8, 1.2), x_m, z_m, turn_rad)


def _there_and_back(score: Score, way: _Way, speed: float) -> None:
    """Turn round, walk away from the cameras, turn again."""
    side = 1.0 if score.rng.random() < 0.5 else -1.0
    start, away = way.front_rad, way.front_rad + side * np.pi
    home = start + (2.0 * side * np.pi if score.rng.random() < 0.5 else 0.0)
    distance = 1.1 + score.jitter(0.15)
    way.to(1.25 / score.style.tempo, way.x_m + 0.15 * side, way.z_m - 0.05, start + 0.55 * (away - start))
    way.to(1.1 / score.style.tempo, way.x_m, way.z_m - 0.25, away)
    way.to(distance / speed + 0.3, way.x_m - 0.2 * side, way.z_m - distance, away)
    way.to(1.25 / score.style.tempo, way.x_m - 0.1 * side, way.z_m - 0.05, 0.5 * (away + home))
    way.to(1.25 / score.style.tempo, way.x_m, way.z_m + 0.15, home)


def _circle(score: Score, way: _Way, speed: float) -> None:
    """Walk a small circle and come back to face the cameras."""
    side = 1.0 if way.x_m < 0.0 else -1.0
    radius = float(score.rng.uniform(0.50, 0.65))
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


def run(score: Score, seconds: float) -> None:
    """Run on the spot with short runs forward and backward."""
    end = score.time_s + seconds
    while end - score.time_s > 1.6:
        gait = styled(RUN, score)
        way = _way(score)
        while way.time_s < end - 1.0:
            _run_leg(score, way)
        stepped(score, gait, way.track, min(way.time_s, end))


def _run_leg(score: Score, way: _Way) -> None:
    rng = score.rng
    speed = 1.2 * score.style.amplitude * score.style.tempo
    x = float(rng.uniform(-0.3, 0.3))
    turn = way.front_rad + score.jitter(0.15)
    kind = int(rng.integers(3))
    if kind == 0:
        way.to(float(rng.uniform(1.2, 2.2)), way.x_m + score.jitter(0.05), way.z_m + score.jitter(0.05), turn)
    elif way.z_m < 0.2:
        z = float(rng.uniform(0.5, 0.9))
        way.to(abs(z - way.z_m) / speed + 0.4, x, z, turn)
    else:
        z = float(rng.uniform(-0.9, -0.5))
        way.to(abs(z - way.z_m) / (0.7 * speed) + 0.4, x, z, turn)
