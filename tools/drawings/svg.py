"""Shapes and text as SVG, one line each."""

from collections.abc import Iterable
from xml.sax.saxutils import escape

from perfanim.core.geometry.arrays import Array

INK, GREY, PALE, MARKER, SPACE = "#333333", "#8a8a8a", "#e3e7ec", "#c22f2f", "#bfe3c4"


def document(width: float, height: float, parts: Iterable[str]) -> str:
    """Return a whole SVG file on a white ground, sizes in pixels."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">'
    return "\n".join([head, f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>', *parts, "</svg>"]) + "\n"


def polygon(points: Array, fill: str, stroke: str = "none") -> str:
    """Return a polygon through points (N, 2)."""
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{text}" fill="{fill}" stroke="{stroke}"/>'


def line(x1: float, y1: float, x2: float, y2: float, colour: str = GREY, dashed: bool = False) -> str:
    """Return a straight line."""
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}"{dash}/>'


def circle(x: float, y: float, radius: float, fill: str, stroke: str = "none") -> str:
    """Return a circle."""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{fill}" stroke="{stroke}"/>'


def text(x: float, y: float, words: str, size: float = 12.0, anchor: str = "start", bold: bool = False) -> str:
    """Return a line of text; `anchor` start, middle or end."""
    weight = ' font-weight="bold"' if bold else ""
    style = f'font-size="{size:.0f}" text-anchor="{anchor}" fill="{INK}"{weight}'
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(words)}</text>'
