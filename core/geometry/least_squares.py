"""Iterated least squares: Gauss-Newton and Levenberg-Marquardt (Nocedal and Wright, Numerical Optimization, 10.3)."""

from collections.abc import Callable
from dataclasses import dataclass
from operator import sub
from typing import Any, TypeVar

import numpy as np

from .arrays import Array

State = TypeVar("State")


def _solve(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0])


def gauss_newton(
    start: State,
    linearise: Callable[[State], tuple[Array, Array]],
    steps: int,
    *,
    smallest: float = 0.0,
    move: Callable[[State, Array], Any] = sub,
    solve: Callable[[Array, Array], Array] = _solve,
) -> tuple[State, Array, Array]:
    """Minimise one sum of squares, or a batch of sums, starting near the minimum.

    Args:
        linearise: Returns residuals (..., R), each divided by its standard deviation, and their Jacobian (..., R, D).
            Robust weights and priors are included in these rows.
        steps: Largest number of steps.
        smallest: Iteration ends when no component of a step is larger than this.
        move: Returns the state minus a step (..., D).
        solve: Solves the normal equations, matrices (..., D, D) and vectors (..., D).

    Returns:
        The final state, with the residuals and the Jacobian there.
    """
    state = start
    for left in range(steps, -1, -1):
        residuals, jacobian = linearise(state)
        if left == 0:
            break
        across = jacobian.swapaxes(-1, -2)
        step = solve(across @ jacobian, (across @ residuals[..., None])[..., 0])
        if np.abs(step).max(initial=0.0) < smallest:
            break
        state = move(state, step)
    return state, residuals, jacobian


@dataclass(frozen=True)
class NormalEquations:
    """A sum of squares near a state: cost, half its gradient (D,) and its Gauss-Newton matrix (D, D)."""

    matrix: Array
    gradient: Array
    cost: float


def levenberg_marquardt(
    start: State,
    linearise: Callable[[State], NormalEquations],
    move: Callable[[State, Array], State],
    *,
    steps: int = 100,
    least_gain: float = 1e-8,
) -> tuple[State, NormalEquations]:
    """Minimise a sum of squares from a rough start; no step increases the cost.

    Args:
        move: Returns the state plus a step (D,).
        steps: Largest number of steps, including rejected ones.
        least_gain: Iteration ends when a step lowers the cost by less than this fraction.

    Returns:
        The state with the lowest cost, and the equations there.
    """
    damping = 1e-4
    state, near = start, linearise(start)
    for _ in range(steps):
        scale = 1.0 / np.sqrt(np.maximum(near.matrix.diagonal(), 1e-30))
        matrix = near.matrix * scale * scale[:, None]
        matrix[np.diag_indices_from(matrix)] += damping
        moved = move(state, -scale * np.linalg.solve(matrix, scale * near.gradient))
        there = linearise(moved)
        if there.cost < near.cost:
            gain = 1.0 - there.cost / near.cost
            state, near, damping = moved, there, max(0.1 * damping, 1e-12)
            if gain < least_gain:
                break
        elif damping < 1e10:
            damping *= 10.0
        else:
            break
    return state, near
