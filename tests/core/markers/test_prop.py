"""Props' definitions: kept in files, and refused where nobody could tell the prop from itself."""

import numpy as np
import pytest
from perfanim.core.errors import PropError
from perfanim.core.markers.prop import Prop, check_distinct, load_prop, prop_names, prop_tables, save_prop

TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.30, 0.0, 0.0], [0.05, 0.20, 0.0]])


def named(points):
    return Prop("stick", tuple("ABCDEFGHIJKLMN"[: len(points)]), np.asarray(points, dtype=np.float64))


def test_prop_round_trip(tmp_path):
    save_prop(Prop("stick", ("A", "B", "C"), TRIANGLE, 0.0004), tmp_path / "stick.toml")
    prop = load_prop(tmp_path / "stick.toml")
    assert (prop.name, prop.names, prop.residual_m) == ("stick", ("A", "B", "C"), 0.0004)
    np.testing.assert_array_equal(prop.positions_m, TRIANGLE)


def test_shipped_props_are_usable():
    assert prop_names()
    for name in prop_names():
        assert load_prop(name).name == name


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (TRIANGLE[:2], "2 markers"),
        (np.outer([0.0, 0.1, 0.3, 0.7], [1.0, 2.0, 0.5]), "on a line"),
        ([[0, 0, 0], [0.1, 0.004, 0], [0.3, 0, 0]], "on a line"),
        ([[0, 0, 0], [0.2, 0, 0], [0.1, 0.3, 0]], "A, B exchanged"),  # isosceles: turned over
        ([[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0], [0, 0.1, 0]], "exchanged"),  # rectangle: turned half round
        ([[0, 0, 0], [0.203, 0, 0], [0.1, 0.3, 0]], "A, B exchanged"),  # hardly different
        ([*TRIANGLE, [0.01, 0.005, 0.0]], "A and D are 11 mm apart"),
        ([[0, 0, 0], [0.3, 0, 0], [0.05, np.nan, 0]], "finite"),
        (np.random.default_rng(0).normal(size=(13, 3)), "13 markers"),
    ],
)
def test_unsuitable_patterns_are_refused(points, reason):
    with pytest.raises(PropError, match=reason):
        named(points)


def test_mirror_images_are_distinct():
    """A prop that is its own mirror image cannot be mirrored by a turn: it is usable."""
    assert named([[-0.1, 0, 0], [0.1, 0, 0], [0, 0.3, 0], [0, 0.1, 0.2]]).names == ("A", "B", "C", "D")


def test_unknown_prop_lists_the_shipped_ones():
    with pytest.raises(PropError, match=r"shipped props: .*sword"):
        load_prop("no-such-thing")


def test_indistinguishable_props_are_refused():
    sword = load_prop("sword")
    check_distinct([sword, named(TRIANGLE)])
    with pytest.raises(PropError, match="same name"):
        check_distinct([sword, sword])
    part = Prop("knife", sword.names[:4], sword.positions_m[:4])
    for pair in ((sword, part), (part, sword)):
        with pytest.raises(PropError, match="knife and sword carry the same pattern"):
            check_distinct(pair)
    assert prop_tables(part)["name"] == "knife"
