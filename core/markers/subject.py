"""Subject: the skeleton and the marker offsets of one person."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np

from ..body.skeleton import Skeleton
from ..errors import SkeletonError, SubjectError
from ..geometry.arrays import Array
from ..system.files import read_toml, reading, write_toml
from ..system.schema import About, Schema, Table, Via, table_of
from .marker_set import MarkerSet

_LONGEST_M = 10.0  # largest length of a bone, and largest distance of a marker from its joint


@dataclass(frozen=True)
class _Joint:
    """One joint of the skeleton, as stored in a subject file."""

    name: Annotated[str, About("unique in the skeleton")]
    parent: Annotated[str, About("an earlier joint; empty for the root")]
    offset_m: Annotated[
        Array, About("from its parent in the rest pose: left, up, forward", "m", -_LONGEST_M, _LONGEST_M, shape=(3,))
    ]
    tip_m: Annotated[Array, About("end of the bone, from the joint", "m", -_LONGEST_M, _LONGEST_M, shape=(3,))]
    angle_axes: Annotated[
        Array, About("quaternion w, x, y, z of the frame of its angles", "", -1.001, 1.001, shape=(4,))
    ]
    angle_order: Annotated[str, About("axes of its angles, such as ZYX; axes about which it cannot turn are left out")]


_JOINT = Schema(_Joint, "Joint", "A joint of a skeleton.", SkeletonError, "choose the character again")


def skeleton_table(skeleton: Skeleton) -> list[dict[str, Any]]:
    """Return the joints of a skeleton as table rows for a file or a message."""
    return list(map(table_of, _joints(skeleton)))


def skeleton_from(rows: Sequence[Table], where: str) -> Skeleton:
    """Return the skeleton from the rows of `skeleton_table`."""
    return _skeleton([_JOINT.read(row, where) for row in rows], where)


def _joints(skeleton: Skeleton) -> tuple[_Joint, ...]:
    parents = (skeleton.names[parent] if parent >= 0 else "" for parent in skeleton.parents)
    arrays = (skeleton.offsets_m, skeleton.tips_m, skeleton.angle_axes)
    return tuple(map(_Joint, skeleton.names, parents, *arrays, skeleton.angle_orders))


def _skeleton(joints: Sequence[_Joint], _where: str) -> Skeleton:
    names = tuple(joint.name for joint in joints)
    return Skeleton(
        names=names,
        parents=np.array([names.index(joint.parent) if joint.parent else -1 for joint in joints]),
        offsets_m=np.array([joint.offset_m for joint in joints]),
        tips_m=np.array([joint.tip_m for joint in joints]),
        angle_axes=np.array([joint.angle_axes for joint in joints]),
        angle_orders=tuple(joint.angle_order for joint in joints),
    )


SkeletonRows: TypeAlias = Annotated[Skeleton, Via(tuple[_Joint, ...], _skeleton, _joints)]


@dataclass(frozen=True)
class Subject:
    """A calibrated person: skeleton and marker offsets."""

    name: Annotated[str, About("name of the person")]
    skeleton: Annotated[SkeletonRows, About("the skeleton, parents first", key="joint")]
    marker_set: Annotated[MarkerSet, About("marker set with all offsets; its keys are those of a marker set file")]
    residual_m: Annotated[
        float,
        About(
            "RMS distance of observed from modelled markers, 0 if uncalibrated", "m", 0.0, _LONGEST_M, optional=False
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        self.marker_set.joint_indices(self.skeleton)
        _ = self.marker_set.offsets_m

    def wearing(self, marker_set: MarkerSet) -> "Subject":
        """Return the subject wearing a set's markers; SubjectError if one of them is not calibrated."""
        unknown = [each.text or each.name for each in marker_set.markers if each.name not in self.marker_set.names]
        if not unknown:
            return replace(self, marker_set=self.marker_set.subset(marker_set.names))
        own = self.marker_set.name
        raise SubjectError(
            f"calibrated with the marker set {own}, which lacks {', '.join(unknown)} of {marker_set.name}",
            where=self.name,
            advice=f"choose {own} as the marker set, or calibrate the performer with {marker_set.name}",
        )


SUBJECT = Schema(
    Subject,
    "Performer",
    "A calibrated person. A file without `kind` and `version` is rejected.",
    SubjectError,
    "calibrate the subject again",
    kind="perfanim subject",
)


def save_subject(subject: Subject, path: str | Path) -> None:
    """Write a subject as TOML."""
    write_toml(path, subject_tables(subject))


def subject_tables(subject: Subject) -> dict[str, Any]:
    """Return the tables of a subject file."""
    return SUBJECT.table(subject)


def load_subject(path: str | Path) -> Subject:
    """Return a subject from its TOML file."""
    return subject_from(read_toml(path), str(path))


def subject_from(table: Table, where: str) -> Subject:
    """Return the subject from a file's tables; SubjectError if these are of another version."""
    worn = table.get("marker_set")
    if isinstance(worn, Mapping):
        table = {**table, "marker_set": {"name": Path(where).stem, **worn}}
    # the file may name a parent that does not exist, or an axis that is not a rotation
    with reading(where, SubjectError, SUBJECT.advice):
        return SUBJECT.read(table, where)
