"""Protection of the outputs of a running command."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ..system.files import is_file, is_folder
from ..system.outputs import check_no_input, claimed

_OUTPUTS = ("out", "picture")


def guarded_run(args: argparse.Namespace, progress: Any) -> Any:
    """Run a command and return its summary.

    Raises:
        PerfanimError: The command failed, an output is one of its inputs, or another program is writing to it.
    """
    outputs = [Path(value) for name in _OUTPUTS if (value := getattr(args, name, None))]
    inputs = [path for name, value in vars(args).items() if name not in _OUTPUTS for path in _paths(value)]
    with ExitStack() as stack:
        for out in outputs:
            check_no_input(out, [path for path in inputs if is_file(path)])
        if outputs and outputs[0].suffix and not is_folder(outputs[0]):  # commands lock their output folders themselves
            stack.enter_context(claimed(outputs[0]))
        return args.run(args, progress)


def _paths(value: Any) -> Iterator[str]:
    """Yield each string in an option's value that may be a path, also in NAME=PATH."""
    if isinstance(value, list | tuple):
        for item in value:
            yield from _paths(item)
    elif isinstance(value, str | Path):
        text = str(value)
        yield text
        yield text.partition("=")[2]
