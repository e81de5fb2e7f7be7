"""Script that runs a command of the command line for Blender, in a Python of its own.

It is run by path, so it has no package: that is made from its place, as the extension's folder may have any name. The
first line on standard input is a JSON object {"root", "paths"}; when the input ends, Blender is gone, and so is this.
"""

import importlib
import importlib.util
import json
import os
import signal
import sys
import threading


def main() -> int:
    """Set the import path up and hand over; returns the exit status."""
    start = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_blender, daemon=True).start()
    sys.path.extend(path for path in start["paths"] if path not in sys.path)
    root = start["root"]
    spec = importlib.util.spec_from_file_location("perfanim", f"{root}/__init__.py", submodule_search_locations=[root])
    if spec is None or spec.loader is None:
        sys.stderr.write(f"perfanim: no package in {root}\n")
        return 1
    package = importlib.util.module_from_spec(spec)
    sys.modules["perfanim"] = package
    spec.loader.exec_module(package)
    status: int = importlib.import_module("perfanim.core.cli.main").main()
    return status


def _end_with_blender() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
