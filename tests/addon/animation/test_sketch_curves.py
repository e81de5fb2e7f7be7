"""Curves of sketches are those that Blender draws between keyframes inserted with its factory settings."""

import bpy
import numpy as np
import pytest
from perfanim.core.sketch.key_interpolation import curve_positions
from played import curves_of

BLENDER_FLOAT = 1e-5  # of values up to 10


def blender_curve(frames, values, at):
    empty = bpy.data.objects.new("control", None)
    bpy.context.scene.collection.objects.link(empty)
    for frame, value in zip(frames, values, strict=True):
        empty.location[0] = value
        empty.keyframe_insert("location", index=0, frame=frame)
    (curve,) = curves_of(empty)
    result = np.array([curve.evaluate(frame) for frame in at])
    bpy.data.objects.remove(empty)
    return result


@pytest.mark.parametrize(
    ("frames", "values"),
    [
        ([4], [2.0]),
        ([1, 9], [0.0, 1.0]),
        ([1, 9, 17, 25, 33], [0.0, 1.0, 0.5, 2.0, 2.1]),
        ([1, 9, 30, 33], [0.0, 1.0, 2.0, 5.0]),  # a handle is clamped at its neighbour's value
        ([1, 5, 9, 13, 17], [0.0, 1.0, 1.0, 3.0, 2.0]),  # two equal keys
    ],
)
def test_curves_are_blenders(frames, values):
    at = np.arange(min(frames) - 5, max(frames) + 6, dtype=float)
    ours = curve_positions(np.array(frames, dtype=float), np.array(values)[:, None], at)[:, 0]
    np.testing.assert_allclose(ours, blender_curve(frames, values, at), atol=BLENDER_FLOAT)


def test_curves_through_random_keys_are_blenders():
    random = np.random.default_rng(7)
    for _ in range(40):
        frames = np.cumsum(random.integers(2, 30, random.integers(3, 11)))
        values = np.cumsum(random.normal(0.3, 1.0, len(frames)))
        at = np.arange(frames[0], frames[-1] + 0.5, 0.5)
        ours = curve_positions(frames.astype(float), values[:, None], at)[:, 0]
        np.testing.assert_allclose(ours, blender_curve(frames.tolist(), values, at), atol=BLENDER_FLOAT)
