"""Where the files shipped with the product lie."""

from pathlib import Path

ASSETS = Path(__file__).resolve().parent.parent / "assets"
MARKER_SETS = ASSETS / "marker_sets"
MOTION = ASSETS / "motion"
PROPS = ASSETS / "props"
SKELETONS = ASSETS / "skeletons.json"
