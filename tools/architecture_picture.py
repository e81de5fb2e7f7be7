"""Draw the packages and their imports as docs/architecture.svg.

    python tools/architecture_picture.py [--check]

Boxes stand on their floors, the top floor first. A line leaves a package downwards and runs right into the package that
it imports from; the number where it turns counts imported modules. `--check` writes nothing, and fails if the file is
out of date.
"""

import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"
ADDON, CORE = "perfanim_addon", "core"
_ROW, _COLUMN, _BOX, _MARGIN = 23, 31, 108, 12  # pixels
_COLOURS = {ADDON: "#e9ddf3", CORE: "#d7e8f7"}

Package = tuple[str, str]  # root, name
Edges = Counter[tuple[Package, Package]]


def count_imports() -> tuple[set[Package], Edges]:
    """Return the packages, and how many modules they import from each other."""
    packages: set[Package] = set()
    edges: Edges = Counter()
    for root in (ADDON, CORE):
        for path in sorted((ROOT / root).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            own = _package(parts)
            if own is None:
                continue
            packages.add(own)
            for module in set(_imported(ast.parse(path.read_text(encoding="utf-8")), parts)):
                other = _package(module)
                if other is not None and other != own:
                    edges[own, other] += 1
    return packages, edges


def _package(parts: tuple[str, ...]) -> Package | None:
    return (parts[0], parts[1]) if len(parts) > 1 and parts[0] in _COLOURS and parts[1] != "__init__" else None


def _imported(tree: ast.AST, parts: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield the modules that a module of this path imports from the project."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield tuple(alias.name.removeprefix("perfanim.").split("."))
        elif isinstance(node, ast.ImportFrom):
            base = parts[: -node.level] if node.level else ()
            module = (*base, *(node.module.split(".") if node.module else ()))
            module = module[1:] if module[:1] == ("perfanim",) else module
            names = [(*module, alias.name) for alias in node.names]
            yield from (name if _is_module(name) else module for name in names)


def _is_module(parts: Iterable[str]) -> bool:
    path = ROOT.joinpath(*parts)
    return path.is_dir() or path.with_suffix(".py").is_file()


def order_floors(packages: Iterable[Package], edges: Edges) -> list[Package]:
    """Return the packages from the top floor down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    contracts = settings["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    waiting = sorted(package for package in packages if package[0] == ADDON)
    order: list[Package] = []
    while waiting:
        # of a circle the package with fewest importers comes first
        users = {package: sum((other, package) in edges for other in waiting) for package in waiting}
        order.append(min(waiting, key=lambda package: (users[package], package)))
        waiting.remove(order[-1])
    return order + [(CORE, layer) for layer in layers]


def draw(packages: set[Package], edges: Edges) -> str:
    """Return the picture as SVG."""
    order = order_floors(packages, edges)
    place = {package: index for index, package in enumerate(order)}
    width = 2 * _MARGIN + _COLUMN * (len(order) - 1) + _BOX
    height = 2 * _MARGIN + _ROW * len(order)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    labels = []
    for index, package in enumerate(order):
        x, y = _MARGIN + _COLUMN * index, _MARGIN + _ROW * index
        below = [place[other] for own, other in edges if own == package and place[other] > index]
        left = [place[own] for own, other in edges if other == package and place[own] < index]
        if below:
            parts.append(_line(x + 14, y + _ROW - 4, x + 14, _MARGIN + _ROW * max(below) + 9))
        if left:
            parts.append(_line(_MARGIN + _COLUMN * min(left) + 14, y + 9, x - 5, y + 9))
            parts.append(f'<path d="M{x - 6} {y + 6}l6 3-6 3z" fill="#777"/>')
        parts.append(f'<rect x="{x}" y="{y}" width="{_BOX}" height="18" rx="3" fill="{_COLOURS[package[0]]}"/>')
        parts.append(f'<text x="{x + 5}" y="{y + 13}" font-size="11">{package[1]}</text>')
    for (own, other), count in sorted(edges.items()):
        upwards = place[other] < place[own]
        x, y = _MARGIN + _COLUMN * place[own] + 14, _MARGIN + _ROW * place[other] + 9
        x, colour = (x + _BOX - 28, "#c00") if upwards else (x, "#333")
        labels.append(f'<circle cx="{x}" cy="{y}" r="7" fill="white" stroke="{colour}" stroke-width="0.6"/>')
        labels.append(f'<text x="{x}" y="{y + 3}" font-size="8" text-anchor="middle" fill="{colour}">{count}</text>')
    legend = [
        "Boxes: packages, each on its floor; add-on above, core below.",
        "Number: modules that the package above it imports from the package to the right.",
        "Red: an import that runs up.",
    ]
    parts += [
        f'<text x="{width - _MARGIN}" y="{_MARGIN + 12 + 15 * row}" font-size="11" text-anchor="end">{text}</text>'
        for row, text in enumerate(legend)
    ]
    return "\n".join([*parts, *labels, "</svg>"]) + "\n"


def _line(x1: int, y1: int, x2: int, y2: int) -> str:
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="#bbb"/>'


def main(arguments: list[str]) -> int:
    """Write the picture, or check it; return 1 if it is old."""
    text = draw(*count_imports())
    if "--check" not in arguments:
        PICTURE.write_text(text, encoding="utf-8")
        return 0
    if PICTURE.is_file() and PICTURE.read_text(encoding="utf-8") == text:
        return 0
    sys.stderr.write("docs/architecture.svg is out of date; run `make architecture-picture`\n")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
