"""Comparison of the two bodies of a stage, and input for it."""

import contextlib
from typing import Any

import numpy as np
from perfanim.core.geometry.camera import Camera
from perfanim.core.kernel.library import Stage
from perfanim.core.solver.observation import Observation


def assert_same(stage: Stage[..., Any], *arguments: Any, rounding: float = 1e-10) -> None:
    """Require equal shapes, types, and values where NumPy's are finite, within a share of their magnitude.

    NumPy computes some products with zeros that the kernel leaves out, so infinite input may spread further there.
    """
    with np.errstate(all="ignore"):
        expected, found = (body(*arguments) for body in (stage.numpy_body, stage.compiled_body))
    pairs = list(zip(expected, found, strict=True)) if isinstance(expected, tuple) else [(expected, found)]
    for mine, theirs in pairs:
        assert mine.shape == theirs.shape
        assert mine.dtype == theirs.dtype
        known = np.isfinite(mine)
        assert np.isfinite(theirs[known]).all()
        largest = np.abs(mine[known]).max(initial=0.0).astype(np.float64)
        np.testing.assert_allclose(theirs[known], mine[known], rtol=0.0, atol=rounding * max(1.0, largest))


def assert_alike(stage: Stage[..., Any], *arguments: Any, rounding: float = 1e-10) -> None:
    """Require the same as `assert_same`; where one body refuses a matrix, the other may also return what is not finite.

    Whether NaN makes a Cholesky decomposition fail depends on NumPy's LAPACK.
    """
    results = []
    for body in (stage.numpy_body, stage.compiled_body):
        with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):
            results.append(body(*arguments))
    if len(results) == 2:
        assert_same(stage, *arguments, rounding=rounding)
    for result in results[: len(results) % 2]:
        assert not all(np.isfinite(each).all() for each in result)


def spoiled(values: np.ndarray, special: float | None, place: int) -> np.ndarray:
    """Return a copy with one special value in it, if any."""
    result = values.copy()
    if special is not None and result.size:
        result.flat[place % result.size] = special
    return result


def seen_by(
    camera: Camera,
    generator: np.random.Generator,
    markers_m: np.ndarray,
    hidden: float,
    rays: float,
    guessed: float,
) -> Observation:
    """Return markers seen by cameras, some hidden from both, or from one with or without a guess of the depth."""
    count = len(markers_m)
    local = camera.to_camera(markers_m)
    hides, single, guess = (generator.uniform(size=count) < share for share in (hidden, rays, guessed))
    alone = ~hides & (single | guess)
    cameras = np.where(alone, 0, -1)
    image_points = np.where(alone[:, None], local[:, :2] / local[:, 2:], np.nan)
    points_m = np.where((hides | (single & ~guess))[:, None], np.nan, markers_m)
    noise_m = generator.uniform(0.0, 0.01, size=(count, 3))
    return Observation(points_m, cameras, image_points, (camera,), noise_m)
