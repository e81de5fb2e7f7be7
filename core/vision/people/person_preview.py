"""Preview of the person that a body network has found, during a capture."""

from collections.abc import Sequence

import cv2

from ...geometry.arrays import Image
from ...markers.marker_frame import MarkerFrame
from ..blob_preview import reduced, write_line

# colours are BGR: lines of the left and the right limbs and of the middle, then points by how well they are known
_LEFT, _RIGHT, _MIDDLE = (255, 190, 90), (90, 190, 255), (230, 230, 230)
_GREEN, _ORANGE, _RED = (80, 255, 80), (60, 170, 255), (80, 80, 255)
_LIMBS = (
    ("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "index"), ("shoulder", "hip"),
    ("hip", "knee"), ("knee", "ankle"), ("ankle", "heel"), ("heel", "foot_index"),
)  # fmt: skip
_ACROSS = ("shoulder", "hip")
_NOBODY = "nobody"


def draw_person(
    frame: MarkerFrame, names: Sequence[str], camera: int, picture: Image, image_width: int, *, placed: bool = True
) -> None:
    """Draw the followed person into a camera's reduced picture (BGR), in place.

    A point is green if another camera sees it in the same place, orange if only this one sees it, and red if it is
    left out, because it is hidden or the cameras contradict each other. The limbs have the colours of their sides.

    Args:
        frame: What `PeoplePipeline.process` returned.
        names: Names of the network's points.
        placed: Whether the cameras are calibrated; if not, all points are orange.
    """
    pixels = frame.detected[camera][:, :2].tolist()
    if not pixels:
        write_line(picture, _NOBODY)
        return
    alone = frame.single_cameras == camera
    meeting = dict(zip(frame.labels.tolist(), frame.point_blobs[:, camera].tolist(), strict=True))
    single = dict(zip(frame.single_labels[alone].tolist(), frame.single_blobs[alone].tolist(), strict=True))
    if not placed:
        single = {label: label for label in range(len(names))}
    meeting = {label: row for label, row in meeting.items() if row >= 0 and label not in single}
    places = {
        name: reduced(pixels[meeting.get(label, single.get(label, label))], picture, image_width)
        for label, name in enumerate(names)
    }
    lines = [(f"{side}_{a}", f"{side}_{b}", colour) for side, colour in (("left", _LEFT), ("right", _RIGHT))
             for a, b in _LIMBS]  # fmt: skip
    lines += [(f"left_{name}", f"right_{name}", _MIDDLE) for name in _ACROSS]
    for a, b, colour in lines:
        if a in places and b in places:
            cv2.line(picture, places[a], places[b], colour, 1, cv2.LINE_AA)
    for label, name in enumerate(names):
        colour = _GREEN if label in meeting else _ORANGE if label in single else _RED
        cv2.circle(picture, places[name], 2, colour, -1, cv2.LINE_AA)
    write_line(picture, f"{len(meeting) or len(single)} of {len(names)} points")
