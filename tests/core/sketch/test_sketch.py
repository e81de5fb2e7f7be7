"""Sketches: their file, their curves, and files that are none."""

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.sketch.sketch import read_sketch

HEAD = "# fps=30\ncontrol,frame,x,y,z\n"


def written(tmp_path, text):
    path = tmp_path / "walk.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_keys_are_read_in_any_order(tmp_path):
    rows = "lhand,17,0.5,1.2,0.3\nhead,1,0,1.7,0\nlhand,1,0.4,1.0,0.2\nlhand,9,0.4,1.1,0.2\n"
    sketch = read_sketch(written(tmp_path, HEAD + "\n# by hand\n" + rows))
    assert (sketch.name, sketch.fps) == ("walk", 30.0)
    hand, head = sketch.controls
    assert (hand.joint, head.joint) == ("lhand", "head")
    assert hand.frames.tolist() == [1.0, 9.0, 17.0]
    np.testing.assert_allclose(hand.positions_m, [[0.4, 1.0, 0.2], [0.4, 1.1, 0.2], [0.5, 1.2, 0.3]])
    assert sketch.frames.tolist() == list(range(1, 18))


def test_curves_meet_their_keys_and_are_held_after_them(tmp_path):
    sketch = read_sketch(
        written(tmp_path, HEAD + "lhand,1,0,1,0\nlhand,9,0.2,1.5,0\nlhand,17,0.9,1.2,0\nhead,30,0,1,0\n")
    )
    hand, head = sketch.controls
    np.testing.assert_allclose(hand.curve(hand.frames), hand.positions_m, atol=1e-12)
    np.testing.assert_allclose(hand.curve(np.array([0.0, 25.0])), hand.positions_m[[0, -1]])
    np.testing.assert_allclose(head.curve(sketch.frames), np.tile([0.0, 1.0, 0.0], (30, 1)))


def test_two_keys_in_one_frame_are_met_half_way(tmp_path):
    sketch = read_sketch(written(tmp_path, HEAD + "lfoot,1,0,0,0\nlfoot,9,0,0,1\nlfoot,9,0,0,2\n"))
    np.testing.assert_allclose(sketch.controls[0].curve(np.array([9.0])), [[0.0, 0.0, 1.5]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no sketch"),
        ("frame,time_s,A_x,A_y,A_z\n", "is no sketch"),
        (HEAD, "has no keys"),
        ("control,frame,x,y,z\nhead,1,0,1,0\n", "frame rate"),
        ("# fps=abc\ncontrol,frame,x,y,z\nhead,1,0,1,0\n", "frame rate"),
        ("# fps=1e9\ncontrol,frame,x,y,z\nhead,1,0,1,0\n", "frame rate"),
        (HEAD + "tail,1,0,1,0\n", "line 3: there is no joint 'tail'"),
        (HEAD + "head,1,0,1\n", "line 3: has 4 fields"),
        (HEAD + "head,1.5,0,1,0\n", "line 3: has no whole frame"),
        (HEAD + "head,1,,1,0\n", "line 3: has no whole frame or no position"),
        (HEAD + "head,1,inf,1,0\n", "line 3: has no whole frame or no position"),
        (HEAD + "head,1,one,1,0\n", "line 3: has a field that is no number"),
        (HEAD + "head,1,5000,1,0\n", "line 3: lies beyond"),
        (HEAD + "head,1,0,1,0\nhead,90000,0,1,0\n", "frames at most"),
        (HEAD + "head,1,0,1,0\x00\n", "is not a text file"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(FormatError) as caught:
        read_sketch(written(tmp_path, text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
