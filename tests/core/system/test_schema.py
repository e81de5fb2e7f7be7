"""Schemas of files: what fits, what each misfit says, and the manual's rows."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.cli.batch.plan import PLAN, SETTINGS, TAKE
from perfanim.core.database.header_facts import FACTS
from perfanim.core.database.public_collections import COLLECTION
from perfanim.core.errors import PropError
from perfanim.core.geometry.rig_file import CAMERA, METADATA
from perfanim.core.markers.label_matching import NAMES
from perfanim.core.markers.marker_set import MARKER_SET
from perfanim.core.markers.prop import PROP
from perfanim.core.markers.subject import SUBJECT
from perfanim.core.retarget.bone_map_files import BONE_MAP
from perfanim.core.system.assets import MARKER_SETS, PROPS
from perfanim.core.system.files import read_toml
from perfanim.core.system.schema import Key, Schema, manual_lines

POINT = (Key("name", "a name", str), Key("place_m", "a place", float, (3,), "m", -1.0, 1.0))
THING = Schema(
    "Thing",
    "A thing.",
    (
        Key("count", "how many", int, (), "", 0, 9),
        Key("turn", "how it lies", float, (3,), or_shape=(3, 3), optional=True),
        Key("lit", "whether", bool, optional=True),
        Key("also", "names", str, (None,), optional=True),
        Key("spots", "places", float, (None, 2), "px", 0.0, optional=True),
        Key("point", "points", POINT, (None,), optional=True),
        Key("main", "a point", POINT, optional=True),
        Key("kind", "its kind", str, choices=("a", "b"), optional=True),
        Key("marks", "texts by name", str, least=1, named=True, optional=True),
        Key("parts", "points by name", POINT, named=True, optional=True),
        Key("open", "others look at it", (), (None,), optional=True),
    ),
    PropError,
    "mend it",
)


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
    ],
)
def test_what_fits_passes(more: dict[str, Any]) -> None:
    THING.check({"count": 5} | more, "x.toml")


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({}, "x.toml: lacks 'count', a whole number from 0 to 9; mend it"),
        ({"count": 9.5}, "x.toml: count must be a whole number from 0 to 9; mend it"),
        ({"count": 10**400}, "x.toml: count must be a whole number from 0 to 9; mend it"),
        (
            {"count": 1, "spots": [[10**400, 2.5]]},
            "x.toml: spots must be a list of rows of two numbers from 0 px on; mend it",
        ),
        ({"count": 10}, "x.toml: count must be a whole number from 0 to 9; mend it"),
        ({"count": True}, "x.toml: count must be a whole number from 0 to 9; mend it"),
        ({"count": math.nan}, "x.toml: count must be a whole number from 0 to 9; mend it"),
        ({"count": 1, "turn": [1, 2]}, "x.toml: turn must be three numbers or 3 x 3 numbers; mend it"),
        ({"count": 1, "turn": [1, 2, math.inf]}, "x.toml: turn must be three numbers or 3 x 3 numbers; mend it"),
        ({"count": 1, "turn": ["1", "2", "3"]}, "x.toml: turn must be three numbers or 3 x 3 numbers; mend it"),
        ({"count": 1, "lit": 1}, "x.toml: lit must be true or false; mend it"),
        ({"count": 1, "also": "ab"}, "x.toml: also must be a list of texts; mend it"),
        (
            {"count": 1, "spots": [[1, 2, 3]]},
            "x.toml: spots must be a list of rows of two numbers from 0 px on; mend it",
        ),
        ({"count": 1, "spots": [[-1, 2]]}, "x.toml: spots must be a list of rows of two numbers from 0 px on; mend it"),
        ({"count": 1, "point": 5}, "x.toml: point must be a list of tables [[point]]; mend it"),
        ({"count": 1, "main": []}, "x.toml: main must be a table [main]; mend it"),
        (
            {"count": 1, "point": [{"name": "a", "place_m": [0, 0, 2]}]},
            "x.toml, a: place_m must be three numbers from -1 to 1 m; mend it",
        ),
        (
            {"count": 1, "point": [{"name": ""}]},
            "x.toml, point 1: lacks 'place_m', three numbers from -1 to 1 m; mend it",
        ),
        ({"count": 1, "kind": "c"}, "x.toml: kind must be one of a, b; mend it"),
        *(
            (
                {"count": 1, "marks": marks},
                "x.toml: marks must be a table [marks] of names, each with a text that is not empty; mend it",
            )
            for marks in ([], "a", {"a": 1}, {"a": ""})
        ),
        ({"count": 1, "parts": {"a": 1}}, "x.toml: parts must be a table [parts] of names, each with a table; mend it"),
        (
            {"count": 1, "parts": {"a" * 99: {"name": "b"}}},
            f"x.toml, {'a' * 18}...{'a' * 18}: lacks 'place_m', three numbers from -1 to 1 m; mend it",
        ),
        ({"count": 1, "open": [1]}, "x.toml: open must be a list of tables [[open]]; mend it"),
        ({"count": 1, "main": {}}, "x.toml, main: lacks 'name', a text; mend it"),
    ],
)
def test_what_does_not_fit_is_named_with_what_it_must_be(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(PropError) as caught:
        THING.check(tables, "x.toml")
    assert str(caught.value) == message


def test_the_manual_has_a_row_for_each_key() -> None:
    lines = manual_lines(THING)
    assert "| `point.place_m` | a place | three numbers from -1 to 1 m |" in lines
    assert "| `lit` | whether | true or false; may be left out |" in lines
    assert len([line for line in lines if line.startswith("| `")]) == len(THING.keys) + 3 * len(POINT)


def test_a_closed_schema_refuses_keys_that_it_does_not_name() -> None:
    closed = Schema("Thing", "A thing.", POINT, PropError, "mend it", closed=True)
    closed.check({"name": "a", "place_m": [0, 0, 0]}, "x.toml")
    with pytest.raises(PropError, match=r"x\.toml: there is no key 'nmae'; keys: name, place_m"):
        closed.check({"nmae": "a", "place_m": [0, 0, 0]}, "x.toml")


def test_tables_of_free_names_are_held_against_one_schema() -> None:
    THING.check_each({"a": {"count": 1}, "b": {"count": 2}}, "x.toml")
    for tables, message in [
        ({"a": 3}, "x.toml: a must be a table; mend it"),
        ({"a": {"count": 1}, "b": {"count": -1}}, "x.toml, b: count must be a whole number from 0 to 9; mend it"),
    ]:
        with pytest.raises(PropError) as caught:
            THING.check_each(tables, "x.toml")
        assert str(caught.value) == message


@pytest.mark.parametrize("path", [*MARKER_SETS.glob("*.toml"), *PROPS.glob("*.toml")], ids=lambda path: path.stem)
def test_schemas_name_every_key_of_the_shipped_files(path: Path) -> None:
    tables, schema = read_toml(path), MARKER_SET if path.parent == MARKER_SETS else PROP
    schema.check(tables, str(path))
    known = {key.name: key.holds for key in schema.keys}
    assert set(tables) <= set(known)
    for row in tables["marker"]:
        assert set(row) <= {key.name for key in known["marker"]}


def test_schemas_of_files_have_an_advice_and_no_key_twice() -> None:
    plans = (PLAN, TAKE, SETTINGS)
    for schema in (MARKER_SET, SUBJECT, PROP, CAMERA, METADATA, BONE_MAP, NAMES, *plans, COLLECTION, FACTS):
        names = [line.split("|")[1] for line in manual_lines(schema) if line.startswith("| `")]
        assert schema.advice and len(set(names)) == len(names) > 0
