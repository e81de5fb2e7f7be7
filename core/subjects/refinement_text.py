"""Changes of a refined performer in words."""

import numpy as np

from ..markers.subject import Subject
from .refine_body import Refinement

_LEAST_SHARE = 0.01  # smaller changes of bones change no pose that one sees
_LEAST_M = 0.003  # nor do those of markers
_MOST_MARKERS = 4  # that are named, to fit a panel
_WORDS = {
    "hips": ("hips", "wider", "narrower"),
    "trunk": ("trunk", "longer", "shorter"),
    "thighs": ("thighs", "longer", "shorter"),
    "shanks": ("lower legs", "longer", "shorter"),
    "feet": ("feet", "longer", "shorter"),
    "arms": ("arms", "longer", "shorter"),
}


def describe_changes(before: Subject, found: Refinement) -> list[str]:
    """Return the changes of bones and markers worth a look, the largest first.

    After ± is twice the standard deviation: the right value lies within 19 times of 20. [] if the body fits as it is.
    """
    return [*_bones(found), *_markers(before, found)]


def _bones(found: Refinement) -> list[str]:
    changed = [part for part, size in found.sizes.items() if abs(size) >= _LEAST_SHARE]
    texts = []
    for part in sorted(changed, key=lambda part: -abs(found.sizes[part])):
        name, more, less = _WORDS[part]
        size, sure = found.sizes[part], 2.0 * found.size_sigmas[part]
        texts.append(
            f"{name} {abs(size):.0%} {more if size > 0.0 else less} (± {max(sure, 0.01):.0%})".replace("%", " %")
        )
    return texts


def _markers(before: Subject, found: Refinement) -> list[str]:
    moved_m = np.linalg.norm(found.subject.marker_set.offsets_m - before.marker_set.offsets_m, axis=1)
    order = [int(index) for index in np.argsort(-moved_m) if moved_m[index] >= _LEAST_M]
    texts = []
    for index in order[:_MOST_MARKERS]:
        marker = before.marker_set.markers[index]
        sure_m = 2.0 * found.offset_sigmas_m[marker.name]
        texts.append(f"marker {marker.text or marker.name} {1e3 * moved_m[index]:.0f} mm (± {1e3 * sure_m:.0f} mm)")
    rest = len(order) - _MOST_MARKERS
    if rest > 0:
        texts.append(f"{rest} more marker{'s' * (rest > 1)} by up to {1e3 * moved_m[order[_MOST_MARKERS]]:.0f} mm")
    return texts
