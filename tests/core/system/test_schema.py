"""Schemas of files: what fits, what each misfit says, and the manual's rows."""

import datetime
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from perfanim.core.cli.batch.plan import PLAN, SETTINGS, TAKE
from perfanim.core.database.header_facts import FACTS
from perfanim.core.database.public_collections import COLLECTION
from perfanim.core.errors import PropError, SettingsError
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.rig_file import CAMERA, METADATA
from perfanim.core.markers.label_matching import NAMES
from perfanim.core.markers.marker_set import MARKER_SET
from perfanim.core.markers.prop import PROP
from perfanim.core.markers.subject import SUBJECT
from perfanim.core.retarget.bone_map_files import BONE_MAP
from perfanim.core.system.assets import MARKER_SETS, PROPS
from perfanim.core.system.files import read_toml
from perfanim.core.system.schema import About, Schema, Table, Via, check_ranges, table_of

Place = tuple[float, float, float]


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Point:
    name: Annotated[str, About("a name")]
    place_m: Annotated[Place, About("a place", "m", -1.0, 1.0)]


@dataclass(frozen=True)
class Ball:
    size: Annotated[int, About("size", least=1)] = 1
    kind: Annotated[str, About("kind", choices=("ball",), optional=False)] = "ball"


@dataclass(frozen=True)
class Box:
    sides: Annotated[tuple[int, ...], About("sides")] = ()
    kind: Annotated[str, About("kind", choices=("box",), optional=False)] = "box"


@dataclass(frozen=True)
class Thing:
    count: Annotated[int, About("how many", least=0, most=9)]
    turn: Annotated[Array | None, About("how it lies", shape=(3,), or_shape=(3, 3))] = None
    lit: Annotated[bool, About("whether")] = False
    also: Annotated[tuple[str, ...], About("names")] = ()
    spots: Annotated[Array | None, About("places", "px", 0.0, shape=(None, 2))] = None
    points: Annotated[tuple[Point, ...], About("points", key="point")] = ()
    main: Annotated[Point | None, About("a point")] = None
    kind: Annotated[str | None, About("its kind", choices=("a", "b"))] = None
    marks: Annotated[Mapping[str, str] | None, About("texts by name", least=1)] = None
    parts: Annotated[Mapping[str, Point] | None, About("points by name")] = None
    open: Annotated[tuple[Table, ...], About("others look at it")] = ()
    mass_kg: Annotated[float | None, About("mass", "kg", above=0.0)] = None
    colour: Annotated[Colour, About("colour")] = Colour.RED
    shape: Annotated[Ball | Box | None, About("shape")] = None
    figures: Annotated[Mapping[str, int | float | None] | None, About("figures")] = None
    date: Annotated[
        datetime.date | None, About("day"), Via(str, lambda text, where: datetime.date.fromisoformat(text), str)
    ] = None
    users: Annotated[tuple[str | int, ...], About("names or numbers")] = ()


THING = Schema(Thing, "Thing", "A thing.", PropError, "mend it")


@pytest.mark.parametrize(
    "more",
    [
        {"turn": [1, 2.5, 3]},
        {"turn": np.eye(3)},
        {"lit": False, "also": []},
        {"also": ["a", "b"], "spots": [[0, 1], (2, 3)]},
        {"point": [{"name": "a", "place_m": [0, 1, -1]}], "main": {"name": "b", "place_m": np.zeros(3)}},
        {"unknown": object(), "lit": None},
        {"count": np.int64(3)},
        {"kind": "b", "marks": {"x": "y", "": "z"}, "parts": {"p": {"name": "", "place_m": [0, 0, 0]}}},
        {"marks": {}, "parts": {}, "open": [{"any": object()}]},
        {
            "colour": "blue",
            "shape": {"kind": "box", "sides": [1, 2]},
            "figures": {"a": 1, "b": None},
            "users": ["a", 3],
        },
    ],
)
def test_what_fits_passes(more: dict[str, Any]) -> None:
    assert THING.read({"count": 5} | more, "x.toml").count in (3, 5)


def test_a_table_becomes_a_dataclass_and_a_table_again() -> None:
    table = {
        "count": 2, "turn": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "lit": True, "also": ["a"],
        "spots": [[0.0, 1.5]], "point": [{"name": "a", "place_m": [0.0, 1.0, -1.0]}], "kind": "a", "marks": {"x": "y"},
        "parts": {"p": {"name": "b", "place_m": [0.0, 0.0, 0.5]}}, "open": [{"any": [1]}], "mass_kg": 0.5,
        "colour": "blue", "shape": {"kind": "ball", "size": 3}, "figures": {"a": 1, "b": None, "c": 2.0},
        "date": "2026-07-31", "users": ["a", 3],
    }  # fmt: skip
    thing = THING.read({**table, "spots": [(0, 1.5)], "unknown": 1}, "x.toml")
    assert thing.points == (Point("a", (0.0, 1.0, -1.0)),) and thing.parts == {"p": Point("b", (0.0, 0.0, 0.5))}
    assert (thing.colour, thing.shape, thing.date) == (Colour.BLUE, Ball(3), datetime.date(2026, 7, 31))
    assert thing.turn is not None and thing.turn.shape == (3, 3) and thing.turn.dtype == np.float64
    assert [type(value) for value in (thing.figures or {}).values()] == [int, type(None), float]
    assert table_of(thing) == table
    assert table_of(Thing(1)) == {"count": 1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 10}, "count must be a whole number from 0 to 9"),
        ({"mass_kg": 0.0}, "mass_kg must be a number above 0 kg"),
        ({"mass_kg": math.nan}, "mass_kg must be a number above 0 kg"),
        ({"kind": "c"}, "kind must be one of a, b"),
    ],
)
def test_values_made_by_programs_are_held_against_their_ranges(change: dict[str, Any], message: str) -> None:
    check_ranges(Thing(3, mass_kg=1.0, kind="a"))
    with pytest.raises(SettingsError) as caught:
        check_ranges(replace(Thing(3), **change))
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({}, ": lacks 'count', a whole number from 0 to 9"),
        ({"count": 9.5}, ": count must be a whole number from 0 to 9"),
        ({"count": 10**400}, ": count must be a whole number from 0 to 9"),
        ({"count": 1, "spots": [[10**400, 2.5]]}, ": spots must be a list of rows of two numbers of at least 0 px"),
        ({"count": 10}, ": count must be a whole number from 0 to 9"),
        ({"count": True}, ": count must be a whole number from 0 to 9"),
        ({"count": math.nan}, ": count must be a whole number from 0 to 9"),
        ({"count": 1, "turn": [1, 2]}, ": turn must be three numbers or 3 x 3 numbers"),
        ({"count": 1, "turn": [1, 2, math.inf]}, ": turn must be three numbers or 3 x 3 numbers"),
        ({"count": 1, "turn": ["1", "2", "3"]}, ": turn must be three numbers or 3 x 3 numbers"),
        ({"count": 1, "lit": 1}, ": lit must be true or false"),
        ({"count": 1, "also": "ab"}, ": also must be a list of strings"),
        ({"count": 1, "spots": [[1, 2, 3]]}, ": spots must be a list of rows of two numbers of at least 0 px"),
        ({"count": 1, "spots": [[-1, 2]]}, ": spots must be a list of rows of two numbers of at least 0 px"),
        ({"count": 1, "point": 5}, ": point must be a list of tables [[point]]"),
        ({"count": 1, "main": []}, ": main must be a table [main]"),
        (
            {"count": 1, "point": [{"name": "a", "place_m": [0, 0, 2]}]},
            ", a: place_m must be three numbers from -1 to 1 m",
        ),
        ({"count": 1, "point": [{"name": ""}]}, ", point 1: lacks 'place_m', three numbers from -1 to 1 m"),
        ({"count": 1, "kind": "c"}, ": kind must be one of a, b"),
        *(
            ({"count": 1, "marks": marks}, ": marks must be a table [marks] of names, each with a non-empty string")
            for marks in ([], "a", {"a": 1}, {"a": ""})
        ),
        ({"count": 1, "parts": {"a": 1}}, ": parts must be a table [parts] of names, each with a table"),
        (
            {"count": 1, "parts": {"a" * 99: {"name": "b"}}},
            f", {'a' * 18}...{'a' * 18}: lacks 'place_m', three numbers from -1 to 1 m",
        ),
        ({"count": 1, "open": [1]}, ": open must be a list of tables [[open]]"),
        ({"count": 1, "main": {}}, ", main: lacks 'name', a string"),
        ({"count": 1, "mass_kg": 0}, ": mass_kg must be a number above 0 kg"),
        ({"count": 1, "colour": "green"}, ": colour must be one of red, blue"),
        ({"count": 1, "shape": {"kind": "cone"}}, ", shape: kind must be one of ball, box"),
        ({"count": 1, "shape": {"kind": "ball", "size": 0}}, ", shape: size must be a whole number of at least 1"),
        ({"count": 1, "users": [1.5]}, ": users must be a list of strings or whole numbers"),
        ({"count": 1, "also": ["a\0"]}, ": also must be a list of strings"),
    ],
)
def test_what_does_not_fit_is_named_with_what_it_must_be(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(PropError) as caught:
        THING.read(tables, "x.toml")
    assert str(caught.value) == f"x.toml{message}; mend it"


def test_the_manual_has_a_row_for_each_key() -> None:
    lines = THING.manual_lines()
    assert "| `point.place_m` | a place | three numbers from -1 to 1 m |" in lines
    assert "| `lit` | whether | true or false; may be left out |" in lines
    keys = len(fields(Thing)) + 3 * len(fields(Point)) + len(fields(Ball)) + len(fields(Box))
    assert len([line for line in lines if line.startswith("| `")]) == keys


def test_a_closed_schema_refuses_keys_that_it_does_not_name() -> None:
    closed = Schema(Point, "Thing", "A thing.", PropError, "mend it", closed=True)
    closed.read({"name": "a", "place_m": [0, 0, 0]}, "x.toml")
    with pytest.raises(PropError, match=r"x\.toml: has an unknown key 'nmae'; known keys: name, place_m"):
        closed.read({"nmae": "a", "place_m": [0, 0, 0]}, "x.toml")


def test_a_kind_of_file_is_told_by_its_kind_and_version() -> None:
    kind = Schema(Point, "Spot", "A spot.", PropError, "make it again", kind="perfanim spot")
    table = {"kind": "perfanim spot", "version": 1, "name": "a", "place_m": [0.0, 0.5, 1.0]}
    assert kind.table(kind.read(table, "x.toml")) == table
    assert "| `version` | 1 | a whole number |" in kind.manual_lines()
    with pytest.raises(PropError, match=r"x\.toml: is not a spot file of this version; make it again"):
        kind.read({**table, "version": 2}, "x.toml")


def test_tables_of_free_names_are_held_against_one_schema() -> None:
    assert THING.read_each({"a": {"count": 1}, "b": {"count": 2}}, "x.toml") == {"a": Thing(1), "b": Thing(2)}
    for tables, message in [
        ({"a": 3}, "x.toml: a must be a table; mend it"),
        ({"a": {"count": 1}, "b": {"count": -1}}, "x.toml, b: count must be a whole number from 0 to 9; mend it"),
    ]:
        with pytest.raises(PropError) as caught:
            THING.read_each(tables, "x.toml")
        assert str(caught.value) == message


@pytest.mark.parametrize("path", [*MARKER_SETS.glob("*.toml"), *PROPS.glob("*.toml")], ids=lambda path: path.stem)
def test_schemas_name_every_key_of_the_shipped_files(path: Path) -> None:
    tables, schema = read_toml(path), MARKER_SET if path.parent == MARKER_SETS else PROP
    schema.read(tables, str(path))
    known = {line.split("`")[1] for line in schema.manual_lines() if line.startswith("| `")}
    assert set(tables) <= known
    for row in tables["marker"]:
        assert {f"marker.{key}" for key in row} <= known


def test_schemas_of_files_have_an_advice_and_no_key_twice() -> None:
    plans = (PLAN, TAKE, SETTINGS)
    for schema in (MARKER_SET, SUBJECT, PROP, CAMERA, METADATA, BONE_MAP, NAMES, *plans, COLLECTION, FACTS):
        names = [line.split("|")[1] for line in schema.manual_lines() if line.startswith("| `")]
        assert schema.advice and len(set(names)) == len(names) > 0
