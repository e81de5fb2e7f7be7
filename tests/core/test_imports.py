"""The core runs without Blender, and its parts depend on each other in one direction only."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import perfanim
import perfanim.core

CORE = Path(perfanim.core.__file__).parent
FILES = sorted(CORE.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Return what a file imports: outer packages by name, modules of the core by their place in it ("solver.root")."""
    found = set()
    package = path.relative_to(CORE).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module or "")
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1]
            inner = ".".join([*base, *([node.module] if node.module else [])])
            found |= {inner} if node.module else {".".join(filter(None, [inner, alias.name])) for alias in node.names}
    return found


def tops_of(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)}


def test_every_module_imports_without_blender() -> None:
    code = (
        "import sys, pkgutil, importlib\n"
        "sys.modules['bpy'] = sys.modules['mathutils'] = None\n"
        "import perfanim.core as core\n"
        "names = [m.name for m in pkgutil.walk_packages(core.__path__, 'perfanim.core.')]\n"
        "[importlib.import_module(name) for name in names if not name.endswith('__main__')]\n"
        "print(len(names))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd="/", check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= len([path for path in FILES if path.name not in ("__init__.py", "__main__.py")])


def test_package_offers_the_api_and_loads_it_late() -> None:
    code = (
        "import sys, perfanim\n"
        "print('numpy' in sys.modules, 'perfanim.core' in sys.modules)\n"
        "from perfanim.core import api\n"
        "print(perfanim.__all__ == api.__all__, all(getattr(perfanim, x) is getattr(api, x) for x in api.__all__))\n"
        "print('cv2' in sys.modules, hasattr(perfanim, 'bl_info'), set(api.__all__) <= set(dir(perfanim)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd="/", check=True)
    assert done.stdout.split("\n") == ["False False", "True True", "False False True", ""]


def test_api_page_names_what_is_public() -> None:
    page = (CORE.parent / "docs" / "api.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert sorted([*re.findall(r"`(\w+)`", " ".join(rows)), "SolvedTake"]) == perfanim.__all__


def test_a_capture_starts_the_cameras_process_before_it_loads_what_is_slow() -> None:
    code = "import sys, perfanim.core.worker.jobs.run_capture; print(*{'cv2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd="/", check=True)
    assert done.stdout.strip() == ""


def test_core_imports_neither_blender_nor_itself_by_name() -> None:
    """Blender loads the package under another name: everything inside is imported relatively."""
    for path in FILES:
        wrong = tops_of(path) & {"bpy", "mathutils", "perfanim", "core", "pickle", "marshal", "shelve"}
        assert not wrong, path


def test_nothing_that_is_shipped_needs_scipy() -> None:
    """It is the only library bound to one version of Python: an archive would be needed for each."""
    for path in (*FILES, *(CORE.parent / "perfanim_addon").rglob("*.py")):
        imports = [
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)
        ]
        assert not [node for node in imports if re.search(r"\b(import|from) scipy\b", ast.unparse(node))], path


def test_library_names_no_command_line_option() -> None:
    """Its messages appear in Blender and in scripts, too."""
    for path in FILES:
        if "cli" in path.relative_to(CORE).parts or path.name in ("blender_process.py", "pip_process.py"):
            continue  # options of other programs
        texts = [node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)]
        found = [text for text in texts if isinstance(text, str) and re.search(r"(?<![-\w`])--[a-z]", text)]
        assert not found, path


def test_packages_depend_downwards() -> None:
    """The contracts are in pyproject.toml."""
    tool = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([tool, "--no-cache"], capture_output=True, text=True, cwd=CORE.parent, check=False)
    assert done.returncode == 0, done.stdout
