import inspect

import pytest
from perfanim.core import errors
from perfanim.core.errors import MOST_TEXT, FormatError, PerfanimError, counted

SUBCLASSES = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if kind is not PerfanimError]


def test_message_says_where_what_and_what_to_do() -> None:
    error = FormatError("is cut off", where="walk.bvh", advice="export it again")
    assert str(error) == "walk.bvh: is cut off; export it again"
    assert (error.what, error.where, error.advice) == ("is cut off", "walk.bvh", "export it again")
    assert str(FormatError("is cut off")) == "is cut off"


def test_a_message_is_one_line_whatever_a_file_holds() -> None:
    error = FormatError("holds\x1b[2J NUL\x85\u2028", where="a\nb\r\x7f.toml", advice="check\tit")
    assert str(error) == r"a\nb\r\x7f.toml: holds\x1b[2J NUL\x85\u2028; check\tit"
    for text in ("\n" * 200, "\ud800" * 200):  # longer when they are escaped
        assert len(str(FormatError(text, where=text, advice=text))) <= MOST_TEXT


def test_a_long_message_loses_lists_and_ends_but_never_the_fact() -> None:
    names = [f"marker{number}" for number in range(290)]
    error = FormatError(
        "the take has no marker " + ", ".join(names), where="/very/long/folder" * 20 + "/walk.trc, line 7",
        advice="its markers are " + ", ".join(names) + "; choose the marker set that was worn",
    )  # fmt: skip
    assert len(str(error)) <= MOST_TEXT
    assert error.what.startswith("the take has no marker marker0, marker1") and error.what.endswith(" more")
    assert error.where.endswith("/walk.trc, line 7")
    short = FormatError("has " + "no " * 200 + "end", where="a.trc", advice="record it again")
    assert short.what.startswith("has no no") and short.what.endswith("no...") and short.advice == "record it again"
    listed = FormatError("is one", advice="give one of " + ", ".join(names) + "; choose the set that was worn")
    assert listed.advice.endswith(" more; choose the set that was worn")


def test_a_counted_noun_is_singular_for_one_only() -> None:
    assert [counted(number, "pose") for number in (0, 1, 2)] == ["0 poses", "1 pose", "2 poses"]


@pytest.mark.parametrize("kind", SUBCLASSES)
def test_every_error_can_be_caught_as_one(kind: type[PerfanimError]) -> None:
    assert issubclass(kind, PerfanimError)
    with pytest.raises(PerfanimError, match="here: broken"):
        raise kind("broken", where="here")
