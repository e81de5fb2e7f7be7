"""Skeletons in a database's JSON header."""

from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import DatabaseError
from ..geometry.arrays import Array, IntArray
from ..system.schema import About, Schema, Table, Via, table_of

REBUILD = "build it again, or import its motion again"
_J = len(JOINT_NAMES)


@dataclass(frozen=True)
class _Body:
    """A standard skeleton in the header."""

    offsets_m: Annotated[Array, About("offset of each joint from its parent", "m", -10.0, 10.0, shape=(_J, 3))]
    tips_m: Annotated[Array, About("offset of each bone's end from its joint", "m", -10.0, 10.0, shape=(_J, 3))]
    angle_axes: Annotated[Array, About("frame of each joint's angles", "", -1.1, 1.1, shape=(_J, 4))]
    angle_orders: Annotated[tuple[str, ...], About("rotation axes of each joint, in order")]
    parents: Annotated[IntArray, About("parent of each joint", "", -1, _J - 1, shape=(_J,))]


BODY = Schema(_Body, "Skeleton", "A standard skeleton in a database.", DatabaseError, REBUILD)


def skeleton_facts(skeleton: Skeleton) -> dict[str, Any]:
    """Return a standard skeleton as values for JSON."""
    return table_of(_body(skeleton))


def skeleton_from_facts(row: Table) -> Skeleton:
    """Return the skeleton from values made by `skeleton_facts`."""
    return _skeleton(BODY.read(row, "skeleton"), "")


def _body(skeleton: Skeleton) -> _Body:
    return _Body(skeleton.offsets_m, skeleton.tips_m, skeleton.angle_axes, skeleton.angle_orders, skeleton.parents)


def _skeleton(body: _Body, _where: str) -> Skeleton:
    return Skeleton(JOINT_NAMES, body.parents, body.offsets_m, body.tips_m, body.angle_axes, body.angle_orders)


BodyTable: TypeAlias = Annotated[Skeleton, Via(_Body, _skeleton, _body)]
