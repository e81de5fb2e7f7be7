"""Draw the pictures of the documents: marker sets and camera places.

    python tools/make_drawings.py [--check]

`--check` writes nothing, and fails if a drawing in docs/drawings is out of date.
"""

import sys
from pathlib import Path

from drawings.marker_set_drawing import draw_marker_set
from drawings.space_drawing import draw_plan, draw_side, usual_rig
from perfanim.core.markers.marker_set import load_marker_set, marker_set_names

DRAWINGS = Path(__file__).resolve().parents[1] / "docs" / "drawings"


def drawings() -> dict[str, str]:
    """Return each drawing's file name and content."""
    rig = usual_rig()
    found = {f"markers-{name}.svg": draw_marker_set(load_marker_set(name)) for name in marker_set_names()}
    return found | {"cameras-from-above.svg": draw_plan(rig), "cameras-from-the-side.svg": draw_side(rig)}


def main(arguments: list[str]) -> int:
    """Write the drawings, or check them; return 1 if one is old, missing or left over."""
    wanted = drawings()
    if "--check" not in arguments:
        DRAWINGS.mkdir(exist_ok=True)
        for name, content in wanted.items():
            (DRAWINGS / name).write_text(content, encoding="utf-8")
        return 0
    there = {path.name: path.read_text(encoding="utf-8") for path in DRAWINGS.glob("*.svg")}
    if there == wanted:
        return 0
    old = sorted(name for name in there.keys() | wanted.keys() if there.get(name) != wanted.get(name))
    sys.stderr.write(f"docs/drawings: out of date: {', '.join(old)}; run tools/make_drawings.py\n")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
