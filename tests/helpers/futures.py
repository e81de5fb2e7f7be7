"""Computations in the background, done at once."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any


def at_once(function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
    """Compute as `Executor.submit` does, but before returning."""
    done: Future[Any] = Future()
    try:
        done.set_result(function(*arguments))
    except Exception as error:
        done.set_exception(error)
    return done
