"""Script that `blender --background --python` runs where Blender's Python module is not there: `retarget_file` in it.

It is run by path, so it has no package: that is made from its place. Behind "--" come a JSON object {"root", "paths"}
(folder of the package, where Python finds what it imports) and the arguments of `retarget_file`.
"""

import importlib
import importlib.util
import json
import sys


def main() -> int:
    """Set the import path up and hand over; returns the exit status."""
    start, *arguments = sys.argv[sys.argv.index("--") + 1 :]
    facts = json.loads(start)
    root = facts["root"]
    sys.path.extend(path for path in facts["paths"] if path not in sys.path)
    spec = importlib.util.spec_from_file_location("perfanim", f"{root}/__init__.py", submodule_search_locations=[root])
    if spec is None or spec.loader is None:
        sys.stderr.write(f"retarget_file: no package in {root}\n")
        return 1
    package = importlib.util.module_from_spec(spec)
    sys.modules["perfanim"] = package
    spec.loader.exec_module(package)
    status: int = importlib.import_module("perfanim.perfanim_addon.retarget_file").main(arguments)
    return status


if __name__ == "__main__":
    sys.exit(main())
