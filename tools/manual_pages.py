"""Pages of the extension's manual: the documentation as HTML, for F1 without a network."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from urllib.parse import urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = (
    "hardware", "wear-markers", "calibration", "capture-in-blender", "motion-data", "when-it-looks-wrong",
    "people", "marker-takes", "batch", "sketch-in-blender", "sketch", "export", "vmc",
)  # fmt: skip
_FRAME = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title} - Perfanim</title><style>
body {{ max-width: 52em; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #222 }}
table {{ border-collapse: collapse }} td, th {{ border: 1px solid #bbb; padding: .3em .6em; text-align: left }}
pre, code {{ background: #f2f2f2 }} pre {{ padding: .8em; overflow-x: auto }} img {{ max-width: 100% }}
</style></head><body><nav>{links}</nav>
{body}</body></html>
"""


def manual_files() -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file of the manual: pages and their pictures."""
    reader = MarkdownIt("commonmark").enable("table")
    pictures: dict[str, Path] = {}
    titles = {name: (DOCS / f"{name}.md").read_text(encoding="utf-8").split("\n")[0].lstrip("# ") for name in PAGES}
    links = " | ".join(f'<a href="{name}.html">{title}</a>' for name, title in titles.items())
    for name, title in titles.items():
        tokens = reader.parse((DOCS / f"{name}.md").read_text(encoding="utf-8"))
        _name_headings(tokens)
        for token in _inner(tokens):
            if token.type == "image":
                source = str(token.attrs["src"])
                pictures[source] = DOCS / source
            elif token.type == "link_open":
                _turn_link(token)
        body = reader.renderer.render(tokens, reader.options, {})
        yield f"{name}.html", _FRAME.format(title=title, links=links, body=body).encode()
    for source, path in sorted(pictures.items()):
        yield source, path.read_bytes()


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as links name it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


def _name_headings(tokens: Sequence[Token]) -> None:
    for opening, content in pairwise(tokens):
        if opening.type == "heading_open":
            opening.attrSet("id", anchor(content.content))


def _inner(tokens: Sequence[Token]) -> Iterator[Token]:
    for token in tokens:
        yield from token.children or ()


def _turn_link(token: Token) -> None:
    """Point a link at a page's HTML; remove it if the manual has no such page."""
    parts = urlsplit(str(token.attrs["href"]))
    if parts.scheme or not parts.path:
        return
    page = parts.path.removesuffix(".md")
    if page in PAGES:
        token.attrSet("href", f"{page}.html" + (f"#{parts.fragment}" if parts.fragment else ""))
    else:
        del token.attrs["href"]
