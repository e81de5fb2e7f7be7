"""The network in JAX, its loss and its training."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.geometry.arrays import Array, FloatArray
from perfanim.core.solver.motion_prior import FARTHEST, LOG_SIGMAS

from .windows import LAGS_S, Batch, WindowMaker

HIDDEN, WIDTH = 64, 512
FEATURES = 9 + 3 * (len(LAGS_S) - 1) + len(LAGS_S)
OUTPUTS = 6 + 3 * (len(JOINT_NAMES) - 1)
_PARTS = (
    ("root",), ("lowerback", "upperback"), ("thorax",), ("lowerneck", "upperneck", "head"),
    *(tuple(side + name for name in names) for side in "lr" for names in (
        ("clavicle",), ("humerus",), ("radius",), ("wrist", "hand", "fingers", "thumb"), ("femur",), ("tibia",),
        ("foot", "toes"),
    )),
)  # fmt: skip
PART_OF_JOINT = np.array([next(i for i, names in enumerate(_PARTS) if name in names) for name in JOINT_NAMES])
_RATE, _WARM_UP = 1.5e-3, 300  # learning rate of Adam, and number of steps after which it is reached
_BETA = 0.5  # exponent in the loss: 0 is the plain likelihood, 1 squared errors (Seitzer et al. 2022)
_AVERAGED = 0.998  # share of the averaged weights that is kept in each step
_REPORT_EVERY = 100
LEAST_SCALE = 0.005  # smallest scale of an output

Parameters = dict[str, Any]


def first_parameters(generator: np.random.Generator) -> Parameters:
    """Return random weights."""
    joints, entries = len(JOINT_NAMES), len(_PARTS) * HIDDEN + len(JOINT_NAMES) - 1

    def random(*shape: int) -> FloatArray:
        return (generator.normal(size=shape) * np.sqrt(1.0 / shape[-2])).astype(np.float32)

    weights = {
        "marker_weights": random(joints, FEATURES, HIDDEN),
        "first_weights": random(entries, WIDTH),
        "weights": random(2, WIDTH, WIDTH),
        "output_weights": 0.1 * random(WIDTH, 2 * OUTPUTS),
    }
    biases = {"marker_biases": (joints, HIDDEN), "biases": (3, WIDTH), "output_biases": (2 * OUTPUTS,)}
    return weights | {name: np.zeros(shape, dtype=np.float32) for name, shape in biases.items()}


def forward(parameters: Parameters, features: Any, seen: Any, joints: Any, bones: Any) -> tuple[Any, Any]:
    """Return outputs and log sigmas (G, N, O), in units of `outputs`.

    Args:
        bones: Standardised lengths (G, J - 1).
    """
    groups, windows, places, _ = features.shape
    flat = features.transpose(0, 2, 1, 3).reshape(groups * places, windows, -1)
    of_marker = joints.reshape(-1)
    hidden = jax.nn.silu(
        jnp.matmul(flat, parameters["marker_weights"][of_marker]) + parameters["marker_biases"][of_marker][:, None]
    )
    hidden = hidden.reshape(groups, places, windows, -1) * seen.transpose(0, 2, 1)[..., None]
    parts = jax.nn.one_hot(jnp.asarray(PART_OF_JOINT)[joints], len(_PARTS))  # shape (G, M, P)
    sums = jnp.einsum("gmp,gmnh->gnph", parts, hidden).reshape(groups, windows, -1)
    first = parameters["first_weights"]
    state = jax.nn.silu(
        sums @ first[: sums.shape[-1]] + (bones @ first[sums.shape[-1] :])[:, None] + parameters["biases"][0]
    )
    for layer in range(2):
        state = state + jax.nn.silu(state @ parameters["weights"][layer] + parameters["biases"][1 + layer])
    both = state @ parameters["output_weights"] + parameters["output_biases"]
    return both[..., :OUTPUTS], jnp.clip(both[..., OUTPUTS:], *LOG_SIGMAS)


def _loss(parameters: Parameters, inputs: tuple[Any, ...], targets: Any) -> tuple[Any, Any]:
    mean, log_sigma = forward(parameters, *inputs)
    error = mean - targets
    unlikely = 0.5 * error**2 * jnp.exp(-2.0 * log_sigma) + log_sigma
    weight = jax.lax.stop_gradient(jnp.exp(2.0 * _BETA * log_sigma))
    return jnp.mean(weight * unlikely), jnp.mean(error**2)


class Scaling(NamedTuple):
    """Units of inputs and outputs: mean and scale (2, n)."""

    bones: FloatArray
    outputs: FloatArray

    def inputs(self, batch: Batch) -> tuple[Any, ...]:
        """Return the inputs of `forward`."""
        return batch.features, batch.seen, batch.joints, (batch.bones - self.bones[0]) / self.bones[1]

    def targets(self, batch: Batch) -> Array:
        """Return the targets in the outputs' units."""
        return np.clip((batch.targets - self.outputs[0]) / self.outputs[1], -FARTHEST, FARTHEST)


def scaling_of(windows: WindowMaker, generator: np.random.Generator) -> Scaling:
    """Return the mean and standard deviation over some windows."""
    drawn = [windows.draw(generator, 64) for _ in range(8)]
    targets = np.concatenate([batch.targets.reshape(-1, OUTPUTS) for batch in drawn])
    bones = np.concatenate([batch.bones for batch in drawn])
    return Scaling(
        np.array((bones.mean(axis=0), np.maximum(bones.std(axis=0), 0.01)), dtype=np.float32),
        np.array((targets.mean(axis=0), np.maximum(targets.std(axis=0), LEAST_SCALE)), dtype=np.float32),
    )


def train(
    windows: WindowMaker,
    scaling: Scaling,
    first: Parameters,
    generator: np.random.Generator,
    steps: int,
    report: Callable[[str], None],
) -> Parameters:
    """Return the trained weights, started from given ones and averaged over the last steps."""
    zeros = jax.tree.map(jnp.zeros_like, first)
    state = (first, zeros, zeros, first)

    def step(state: Any, number: Any, inputs: Any, targets: Any) -> Any:
        parameters, first, second, averaged = state
        (_, square), slopes = jax.value_and_grad(_loss, has_aux=True)(parameters, inputs, targets)
        norm = jnp.sqrt(sum(jnp.sum(slope**2) for slope in jax.tree.leaves(slopes)))
        size = jnp.where(jnp.isfinite(norm), 1.0 / jnp.maximum(1.0, norm), 0.0)
        slopes = jax.tree.map(lambda slope: size * jnp.nan_to_num(slope), slopes)
        rate = _RATE * jnp.minimum(1.0, number / _WARM_UP) * 0.5 * (1.0 + jnp.cos(jnp.pi * number / steps))
        first = jax.tree.map(lambda m, slope: 0.9 * m + 0.1 * slope, first, slopes)
        second = jax.tree.map(lambda v, slope: 0.99 * v + 0.01 * slope**2, second, slopes)
        unbias = jnp.sqrt(1.0 - 0.99**number) / (1.0 - 0.9**number)
        parameters = jax.tree.map(
            lambda p, m, v: p - rate * unbias * m / (jnp.sqrt(v) + 1e-8), parameters, first, second
        )
        averaged = jax.tree.map(lambda a, p: _AVERAGED * a + (1.0 - _AVERAGED) * p, averaged, parameters)
        return (parameters, first, second, averaged), square

    run = jax.jit(step)
    started, squares = time.monotonic(), []
    for number in range(1, steps + 1):
        batch = windows.draw(generator, 32)
        state, square = run(state, np.float32(number), scaling.inputs(batch), scaling.targets(batch))
        squares.append(square)
        if number % _REPORT_EVERY == 0:
            mean = float(np.mean(np.array(squares[-_REPORT_EVERY:])))
            report(f"step {number} of {steps}, {time.monotonic() - started:.0f} s, squared error {mean:.4f}")
    return jax.tree.map(np.asarray, state[3])


def residuals(
    parameters: Parameters, windows: WindowMaker, scaling: Scaling, generator: np.random.Generator, batches: int
) -> tuple[Array, Array]:
    """Return errors and expected sigmas (n, O), in the targets' units."""
    errors, sigmas = [], []
    run = jax.jit(forward)
    for _ in range(batches):
        batch = windows.draw(generator, 32)
        mean, log_sigma = (np.asarray(each) for each in run(parameters, *scaling.inputs(batch)))
        errors.append((scaling.outputs[1] * (scaling.targets(batch) - mean)).reshape(-1, OUTPUTS))
        sigmas.append((scaling.outputs[1] * np.exp(log_sigma)).reshape(-1, OUTPUTS))
    return np.concatenate(errors), np.concatenate(sigmas)
