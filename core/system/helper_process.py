"""Starts a helper process that imports the package and runs one function.

A new process cannot import the package by name, because the extension's folder may have any name (in Blender it is
bl_ext.<repository>.perfanim). Therefore this file is run by its path, imports only the standard library, and creates
the package from its folder. The request, which says what to run, is one line of JSON on standard input, because
other users can see a command line; only Blender, which runs this file with `--python`, gets it after "--".
"""

import importlib
import importlib.util
import json
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SCRIPT = str(Path(__file__).resolve())


def command(python: str) -> list[str]:
    """Return the command line of a helper process; the order is written to its standard input."""
    return [python, "-I", SCRIPT]


def run_request(run: Callable[..., Any] | str, *arguments: Any, paths: Sequence[str] | None = None) -> str:
    """Return a request to run a function in a helper process: one line of JSON without a line break.

    Args:
        run: Function at the top level of a module; its return value becomes the exit status. A string ("module:name",
            with `perfanim` for the package) names a function that this process cannot import.
        arguments: Its arguments; they must be representable in JSON.
        paths: Import path of the process; by default that of this process.
    """
    package = __name__.partition(".core.")[0]
    if not isinstance(run, str):
        module = run.__module__
        inside = module == package or module.startswith(f"{package}.")
        run = f"{'perfanim' + module[len(package) :] if inside else module}:{run.__qualname__}"
    root = str(Path(next(iter(sys.modules[package].__path__))).resolve())
    return json.dumps(
        {"root": root, "paths": list(sys.path if paths is None else paths), "run": run, "arguments": arguments}
    )


def main() -> Any:
    """Run the function of the order and return its result."""
    if "--" in sys.argv:
        text = sys.argv[sys.argv.index("--") + 1]
    else:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started this one will end it
        text = sys.stdin.readline()
    content = json.loads(text)
    sys.path.extend(path for path in content["paths"] if path not in sys.path)
    root = content["root"]
    spec = importlib.util.spec_from_file_location("perfanim", f"{root}/__init__.py", submodule_search_locations=[root])
    if spec is None or spec.loader is None:
        return f"cannot import the package in {root}"
    package = importlib.util.module_from_spec(spec)
    sys.modules["perfanim"] = package
    spec.loader.exec_module(package)
    module, _, name = content["run"].partition(":")
    return getattr(importlib.import_module(module), name)(*content["arguments"])


if __name__ == "__main__":
    sys.exit(main())
