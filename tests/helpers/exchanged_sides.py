"""Takes with the labels of left and right exchanged."""

from dataclasses import replace

from perfanim.core.markers.marker_take import MarkerTake


def sides_exchanged(take: MarkerTake) -> MarkerTake:
    """Return a take in which LKNE and RKNE, LTOE and RTOE and so on have each other's labels."""
    others = [{"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:] for name in take.names]
    columns = [take.names.index(other) if other in take.names else at for at, other in enumerate(others)]
    return replace(take, positions_m=take.positions_m[:, columns])
