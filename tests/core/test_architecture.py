"""docs/architecture.md names files, names and packages that are there."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
REFERENCES = sorted(set(re.findall(r"`((?:core|perfanim_addon|tests|tools|assets)/[^`]*)`", PAGE)))


@pytest.mark.parametrize("reference", REFERENCES)
def test_reference(reference: str) -> None:
    path, _, name = reference.partition(":")
    assert (ROOT / path).exists()
    if name:
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert name in defined


@pytest.mark.parametrize("root", ["core", "perfanim_addon"])
def test_every_package_is_listed_once(root: str) -> None:
    listed = re.findall(rf"^\| `{root}/(\w+)(?:/|\.py)` \|", PAGE, re.MULTILINE)
    modules = {path.stem for path in (ROOT / root).glob("*") if (path / "__init__.py").exists() or path.suffix == ".py"}
    assert sorted(listed) == sorted(modules - {"__init__"})


def test_core_is_listed_by_its_floors() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    assert re.findall(r"^\| `core/(\w+)(?:/|\.py)` \|", PAGE, re.MULTILINE) == layers


@pytest.mark.parametrize("document", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda p: p.name)
def test_links_between_documents(document: Path) -> None:
    for link in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", document.read_text(encoding="utf-8")):
        assert (document.parent / link).exists(), link
