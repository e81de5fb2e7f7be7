"""Settings of the documentation's generator, Sphinx; run by `make docs`."""

import re
from pathlib import Path
from typing import Any

from perfanim.core import __version__
from perfanim.core.cli.batch.plan import PLAN, SETTINGS, TAKE
from perfanim.core.database.public_collections import COLLECTION
from perfanim.core.geometry.rig_file import CAMERA, METADATA
from perfanim.core.markers.label_matching import NAMES
from perfanim.core.markers.marker_set import MARKER_SET
from perfanim.core.markers.prop import PROP
from perfanim.core.markers.subject import SUBJECT
from perfanim.core.retarget.bone_map_files import BONE_MAP

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent

project = "Perfanim"
author = "The perfanim developers"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinxarg.ext"]
html_theme = "furo"
html_title = f"Perfanim {__version__}"
html_copy_source = False
default_role = "code"  # docstrings write names as `name`
myst_heading_anchors = 4
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
napoleon_use_rtype = False


def write_api_pages(app: Any) -> None:
    """Write a page for each package of the core, with the public names of its modules."""
    target = DOCS / "api"
    target.mkdir(exist_ok=True)
    for old in target.glob("*.md"):
        old.unlink()
    for package in sorted(path.parent for path in (ROOT / "core").glob("*/__init__.py")):
        if package.name == "cli":  # the commands have a page of their own
            continue
        lines = [f"# core/{package.name}"]
        for module in sorted(package.rglob("*.py")):
            name = module.relative_to(ROOT).with_suffix("").as_posix()
            if module.name != "__init__.py":
                dotted = "perfanim." + name.replace("/", ".")
                lines += ["", f"## {name}", "", "```{eval-rst}", f".. automodule:: {dotted}", "   :members:", "```"]
        (target / f"{package.name}.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_schemas_page(app: Any) -> None:
    """Write the page of TOML files, from the schemas that their readers check."""
    about = (
        "All keys that are read, with their units and ranges. Other keys are refused in plans and left alone elsewhere."
    )
    lines = ["# TOML files", "", about, ""]
    for schema in (CAMERA, METADATA, MARKER_SET, SUBJECT, PROP, NAMES, BONE_MAP, PLAN, TAKE, SETTINGS, COLLECTION):
        lines += schema.manual_lines()
    (DOCS / "toml-files.md").write_text("\n".join(lines), encoding="utf-8")


def escape_markup(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Escape what reStructuredText would read as markup outside of `code`, in place."""
    for number, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [re.sub(r"([*|])|(_)(?!\w)", r"\\\1\2", part) for part in parts[::2]]
        lines[number] = "`".join(parts)


def setup(app: Any) -> None:
    """Connect all; the escaping comes before napoleon reads the sections."""
    app.connect("builder-inited", write_api_pages)
    app.connect("builder-inited", write_schemas_page)
    app.connect("autodoc-process-docstring", escape_markup, priority=400)
