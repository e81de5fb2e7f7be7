"""Schemas of files: what fits, what each misfit says, and the manual's rows."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.errors import PropError
from perfanim.core.geometry.rig_file import CAMERA
from perfanim.core.markers.marker_set import MARKER_SET
from perfanim.core.markers.prop import PROP
from perfanim.core.markers.subject import SUBJECT
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
    assert len([line for line in lines if line.startswith("| `")]) == len(THING.keys) + 2 * len(POINT)


@pytest.mark.parametrize("path", [*MARKER_SETS.glob("*.toml"), *PROPS.glob("*.toml")], ids=lambda path: path.stem)
def test_schemas_name_every_key_of_the_shipped_files(path: Path) -> None:
    tables, schema = read_toml(path), MARKER_SET if path.parent == MARKER_SETS else PROP
    schema.check(tables, str(path))
    known = {key.name: key.holds for key in schema.keys}
    assert set(tables) <= set(known)
    for row in tables["marker"]:
        assert set(row) <= {key.name for key in known["marker"]}


def test_schemas_of_files_have_an_advice_and_no_key_twice() -> None:
    for schema in (MARKER_SET, SUBJECT, PROP, CAMERA):
        names = [line.split("|")[1] for line in manual_lines(schema) if line.startswith("| `")]
        assert schema.advice and len(set(names)) == len(names) > 3
