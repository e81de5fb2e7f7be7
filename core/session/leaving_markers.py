"""Markers that leave their places on a solved body for a moment: wild points that no path of a single marker shows."""

import warnings
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..geometry.arrays import Array, Mask
from ..markers.source_noise import SourceNoise


@dataclass(frozen=True)
class LeavingSettings:
    """Settings of `leaves_body`, chosen on eight development takes with flicker and wild points, and on fast dances."""

    far_m: float = 0.035  # distance on the body beyond which a marker is in another place
    sudden: float = 6.0  # the same, relative to the median of the marker's steps on the body around that time
    end: float = 0.5  # share of that distance from which a marker is suspected at an end, where the body follows it
    beside_s: float = 0.1  # longest time to the frames before and after with which a marker is compared
    around: int = 3  # time on either side for that median, in units of `beside_s`


_S = LeavingSettings()


def leaves_body(seen_m: Array, worn_m: Array, fps: float, source: SourceNoise, judged: bool) -> Mask:
    """Return a mask (F, M) of the markers that are far from where they are just before and after, on the body.

    They must be far in the world, too: when a marker returns after a while, the body moves, and not the marker. Where
    nothing is seen before, or nothing after, the nearest frame decides.

    Args:
        seen_m: Markers (F, M, 3), NaN where hidden.
        worn_m: The same markers on the solved body.
        judged: The body does not depend on the suspected markers, so its own sudden motion counts, too.
    """
    lags = max(round(_S.beside_s * fps), 1)
    frames, most = len(seen_m), _S.around * lags
    world_m, body_m = (
        np.pad(each, ((most, most), (0, 0), (0, 0)), constant_values=np.nan) for each in (seen_m, seen_m - worn_m)
    )

    def at(rows: Array, lag: int) -> Array:
        return rows[most + lag : most + lag + frames]

    ways = range(-lags, 0), range(1, lags + 1)
    away_m = {
        lag: np.min([np.linalg.norm(at(each, lag) - at(each, 0), axis=-1) for each in (world_m, body_m)], axis=0)
        for lag in (*ways[0], *ways[1])
    }
    far_m = np.full(seen_m.shape[:2], _S.far_m + source.lasting_m)
    if judged:
        steps_m = np.linalg.norm(np.diff(body_m, axis=0, append=np.full((1, *body_m.shape[1:]), np.nan)), axis=-1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # for markers that are hidden all the time
            usual_m = np.nanmedian([at(steps_m, lag) for lag in range(-most, most)], axis=0)
        far_m = np.fmax(far_m, _S.sudden * usual_m)
    leaves = np.zeros(seen_m.shape[:2], dtype=bool)
    for before, after in product(*ways):
        returns = np.linalg.norm(at(body_m, after) - at(body_m, before), axis=-1) < far_m
        leaves |= returns & (away_m[before] > far_m) & (away_m[after] > far_m)
    for way, other in (ways, ways[::-1]):
        is_end = np.all([np.isnan(away_m[lag]) for lag in way], axis=0)
        nearest_m = np.full(leaves.shape, np.nan)
        for lag in sorted(other, key=abs):
            nearest_m = np.where(np.isnan(nearest_m), away_m[lag], nearest_m)
        leaves |= is_end & (nearest_m > (far_m if judged else _S.end * far_m))
    return leaves
