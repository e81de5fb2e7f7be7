"""Script that the worker's Python runs: makes the extension importable as `perfanim`, then starts `process.main`.

It is run by path, so it has no package and no relative imports. The extension's folder may have any name (Blender
calls it bl_ext.<repository>.perfanim), so the package is made from its place. What it needs comes as one JSON line
on standard input: {"root", "paths", "port", "token"}; on the command line other users could read the token.
"""

import importlib.util
import json
import sys


def main() -> int:
    """Set the import path up and hand over to the worker; returns its exit status."""
    start = json.loads(sys.stdin.readline())
    sys.path.extend(path for path in start["paths"] if path not in sys.path)
    root = start["root"]
    spec = importlib.util.spec_from_file_location("perfanim", f"{root}/__init__.py", submodule_search_locations=[root])
    if spec is None or spec.loader is None:
        sys.stderr.write(f"no extension in {root}\n")
        return 1
    package = importlib.util.module_from_spec(spec)
    sys.modules["perfanim"] = package
    spec.loader.exec_module(package)
    process = importlib.import_module("perfanim.core.worker.process")
    status: int = process.main(int(start["port"]), str(start["token"]))
    return status


if __name__ == "__main__":
    sys.exit(main())
