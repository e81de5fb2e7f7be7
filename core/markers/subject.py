"""Subject: the skeleton and the marker offsets of one person."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton
from ..errors import SubjectError
from ..system.files import read_toml, reading, write_toml
from ..system.schema import Key, Schema
from .marker_set import MARKER_SET_KEYS, MarkerSet, marker_set_from, marker_set_table

_KIND, _VERSION = "perfanim subject", 1
JOINT_KEYS = (
    Key("name", "unique", str),
    Key("parent", "a joint before it; empty for the root", str),
    Key("offset_m", "from its parent in the rest pose: left, up, forward", float, (3,), "m", -10.0, 10.0),
    Key("tip_m", "end of the bone, from the joint", float, (3,), "m", -10.0, 10.0),
    Key("angle_axes", "quaternion w, x, y, z of the frame of its angles", float, (4,), "", -1.001, 1.001),
    Key("angle_order", "axes of its angles, such as ZYX; those that it lacks are left out", str),
)
SUBJECT = Schema(
    "Performer",
    "A calibrated person. Without `kind` and `version` a file is none.",
    (
        Key("kind", f'"{_KIND}"', str),
        Key("version", str(_VERSION), int),
        Key("name", "of the person", str),
        Key("residual_m", "RMS distance of seen and modelled markers when calibrated", float, (), "m", 0.0, 10.0),
        Key("marker_set", "worn, with all offsets; keys as below Marker set", MARKER_SET_KEYS),
        Key("joint", "the skeleton, parents first", JOINT_KEYS, (None,)),
    ),
    SubjectError,
    "calibrate the subject again",
)


@dataclass(frozen=True)
class Subject:
    """A calibrated person: skeleton and marker offsets.

    Args:
        residual_m: RMS distance between seen and modelled markers of the calibration pose (0 when not calibrated).
    """

    name: str
    skeleton: Skeleton
    marker_set: MarkerSet
    residual_m: float = 0.0

    def __post_init__(self) -> None:
        self.marker_set.joint_indices(self.skeleton)
        _ = self.marker_set.offsets_m

    def wearing(self, marker_set: MarkerSet) -> "Subject":
        """Return the subject with a set's markers; SubjectError for one not calibrated."""
        unknown = [each.text or each.name for each in marker_set.markers if each.name not in self.marker_set.names]
        if not unknown:
            return replace(self, marker_set=self.marker_set.subset(marker_set.names))
        own = self.marker_set.name
        raise SubjectError(
            f"calibrated with the markers {own}, without {', '.join(unknown)} of {marker_set.name}",
            where=self.name,
            advice=f"choose {own} as the marker set, or calibrate the performer with {marker_set.name}",
        )


def save_subject(subject: Subject, path: str | Path) -> None:
    """Write a subject as TOML."""
    write_toml(path, subject_tables(subject))


def subject_tables(subject: Subject) -> dict[str, Any]:
    """Return the tables of a subject file."""
    return {
        "kind": _KIND,
        "version": _VERSION,
        "name": subject.name,
        "residual_m": float(subject.residual_m),
        "marker_set": marker_set_table(subject.marker_set),
        "joint": skeleton_table(subject.skeleton),
    }


def skeleton_table(skeleton: Skeleton) -> list[dict[str, Any]]:
    """Return the joints of a skeleton as rows of a file or a message."""
    return [
        {
            "name": name,
            "parent": skeleton.names[parent] if parent >= 0 else "",
            "offset_m": skeleton.offsets_m[i],
            "tip_m": skeleton.tips_m[i],
            "angle_axes": skeleton.angle_axes[i],
            "angle_order": skeleton.angle_orders[i],
        }
        for i, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True))
    ]


def load_subject(path: str | Path) -> Subject:
    """Return a subject from its TOML file."""
    return subject_from(read_toml(path), str(path))


def subject_from(table: Mapping[str, Any], where: str) -> Subject:
    """Return the subject of a file's tables; SubjectError for another version."""
    if table.get("kind") != _KIND or table.get("version") != _VERSION:
        raise SubjectError("is not a subject file of this version", where=where, advice=SUBJECT.advice)
    SUBJECT.check(table, where)
    with reading(where, SubjectError, SUBJECT.advice):  # a parent that there is not, an angle that is none
        skeleton = skeleton_from(table["joint"])
        marker_set = marker_set_from(table["marker_set"], where=where)
        return Subject(table["name"], skeleton, marker_set, float(table["residual_m"]))


def skeleton_from(joints: list[Mapping[str, Any]]) -> Skeleton:
    """Return the skeleton of rows as `skeleton_table` makes them."""
    names = tuple(str(joint["name"]) for joint in joints)
    return Skeleton(
        names=names,
        parents=np.array([names.index(j["parent"]) if j["parent"] else -1 for j in joints]),
        offsets_m=np.array([j["offset_m"] for j in joints]),
        tips_m=np.array([j["tip_m"] for j in joints]),
        angle_axes=np.array([j["angle_axes"] for j in joints]),
        angle_orders=tuple(str(j["angle_order"]) for j in joints),
    )
