"""The walks of `make walks` go through; that of a technical director takes minutes and is left to the target."""

import shutil

import pytest
from walks import developer
from walks.page import Walk, WalkError


@pytest.mark.skipif(shutil.which("git") is None, reason="the copy has the files that git knows")
def test_a_marker_file_format_is_added_by_the_page_alone(tmp_path):
    developer.walk_through(tmp_path / "walk")
    page = (tmp_path / "walk" / "index.html").read_text(encoding="utf-8")
    assert "<h2>9. It is there</h2>" in page
    assert "format: marker take" in page
    for name in developer._BULLETS:
        assert name in page


def test_a_step_that_ends_otherwise_stops_the_walk(tmp_path):
    walk = Walk("A walk", tmp_path / "walk")
    walk.step("A take that is not there")
    assert "no.c3d" in walk.run("perfanim", "take", "info", "no.c3d", status=1)
    with pytest.raises(WalkError, match="exit status 1, not 0"):
        walk.run("perfanim", "take", "info", "no.c3d")
    walk.note("\n".join(f"line {number}" for number in range(100)))
    page = (tmp_path / "walk" / "index.html").read_text(encoding="utf-8")
    assert "$ perfanim take info no.c3d" in page
    assert "line 0" in page and "line 99" in page and "line 50" not in page
