"""Every tool can be imported: a module or a name it uses may have moved."""

import importlib
import importlib.util
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
MODULES = [".".join(path.relative_to(TOOLS).with_suffix("").parts) for path in sorted(TOOLS.rglob("*.py"))]
OF_EXTRAS = {"jax": ("train_prior", "prior_training.network"), "pymomentum": ("bench.momentum_solve",), "atheris": ()}
MISSING = [name for package, names in OF_EXTRAS.items() if importlib.util.find_spec(package) is None for name in names]


@pytest.mark.parametrize("module", [name for name in MODULES if not name.endswith("__init__") and name not in MISSING])
def test_imports(module: str) -> None:
    pytest.importorskip("bpy", reason="some tools need the bpy wheel")
    importlib.import_module(module)
