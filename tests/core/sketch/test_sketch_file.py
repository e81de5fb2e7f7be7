"""Sketches: their file, their curves, and files that are none."""

import numpy as np
import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.sketch.sketch_file import Control, Sketch, read_sketch, tilted
from perfanim.core.sketch.sketch_messages import sketch_from
from perfanim.core.system.schema import table_of

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


def drawn():
    """A hand that waits, then jumps."""
    drawn_m = np.zeros((9, 3))
    drawn_m[5:] = 0.0, 0.0, 1.0
    return Control("lhand", np.array([1.0, 9.0]), drawn_m[[0, -1]], drawn_m)


def test_a_drawn_curve_takes_the_place_of_the_default():
    control = drawn()
    np.testing.assert_allclose(control.curve(np.array([-3.0, 5.0, 5.5, 6.0, 20.0]))[:, 2], [0.0, 0.0, 0.5, 1.0, 1.0])


def test_a_drawn_curve_is_bent_to_a_key_off_it():
    dragged = Control(
        "lhand", np.array([1.0, 4.0, 9.0]), np.array([[0, 0, 0], [0, 0.3, 0], [0, 0, 1.0]]), drawn().drawn_m
    )
    np.testing.assert_allclose(dragged.curve(dragged.frames), dragged.positions_m, atol=1e-12)
    assert dragged.curve(np.array([5.0]))[0, 2] == 0.0


def test_a_drawn_curve_is_tilted_with_its_keys():
    sketch = Sketch("one", 30.0, (drawn(),))
    (control,) = tilted(sketch, rot.from_rotation_vector(np.array([0.4, 0.0, 0.0]))).controls
    np.testing.assert_allclose(control.drawn_m[[0, -1]], control.positions_m, atol=1e-12)


def test_messages_keep_curves_and_free_heights():
    hand, hips = drawn(), Control("root", np.array([1.0]), np.ones((1, 3)), height_is_free=True)
    table = table_of(Sketch("two", 30.0, (hand, hips)))
    one, other = sketch_from(table).controls
    np.testing.assert_allclose(one.drawn_m, hand.drawn_m)
    assert (one.height_is_free, other.height_is_free, other.drawn_m) == (False, True, None)
    table["controls"][0]["drawn_m"] = table["controls"][0]["drawn_m"][:16]
    with pytest.raises(SettingsError, match="damaged"):
        sketch_from(table)
