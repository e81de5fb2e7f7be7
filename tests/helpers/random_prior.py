"""A motion prior with random weights: what it says means nothing, but it is well formed."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.motion_prior import VERSION, WEIGHTS

LAGS_S = np.array([0.0, 1 / 60, 0.1, 0.5])
JOINTS, HIDDEN, WIDTH = 29, 5, 8
FEATURES, OUTPUTS = 9 + 3 * 3 + 4, 6 + 3 * 28


def write_network(path: Path, mean_rotations: np.ndarray, **changes: Any) -> Path:
    """Write a small network with random weights, with some entries replaced."""
    generator = np.random.default_rng(0)
    random = lambda *shape: 0.3 * generator.normal(size=shape)  # noqa: E731
    part = np.arange(JOINTS) // 4
    square = random(OUTPUTS, 4 * OUTPUTS)
    correlation = square @ square.T
    size = np.sqrt(np.diag(correlation))
    arrays = {
        "lags_s": LAGS_S,
        "mean_rotations": rot.multiply(mean_rotations, rot.from_rotation_vector([0.1, 0, 0])),
        "part_of_joint": part, "bones": np.array((np.full(28, 0.2), np.full(28, 0.1))),
        "marker_weights": random(JOINTS, FEATURES, HIDDEN), "marker_biases": random(JOINTS, HIDDEN),
        "first_weights": random((part.max() + 1) * HIDDEN + 28, WIDTH), "weights": random(2, WIDTH, WIDTH),
        "biases": random(3, WIDTH), "output_weights": random(WIDTH, 2 * OUTPUTS), "output_biases": random(2 * OUTPUTS),
        "outputs": np.array((random(OUTPUTS), np.full(OUTPUTS, 0.2))),
        "correlation": correlation / np.outer(size, size), "spread": 1.0 + random(2, OUTPUTS) ** 2,
    }  # fmt: skip
    for name in WEIGHTS:
        arrays[name] = arrays[name].astype(np.float16)
    np.savez(path, **(arrays | {"facts": np.array(json.dumps({"version": VERSION, "subjects": ["14"]}))} | changes))
    return path
