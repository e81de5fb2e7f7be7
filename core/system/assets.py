"""Paths of the shipped files."""

from .. import PACKAGE_ROOT

ASSETS = PACKAGE_ROOT / "assets"
BATCH_STYLE = ASSETS / "batch_report.css"
CHARACTER = ASSETS / "character.npz"
COLLECTIONS = ASSETS / "public_collections.toml"
JOINTS = ASSETS / "joints.toml"
MARKER_SETS = ASSETS / "marker_sets"
MOTION = ASSETS / "motion"
MOTION_PRIOR = ASSETS / "motion_prior.npz"
PERFORMANCES = ASSETS / "performances"
PROPS = ASSETS / "props"
SKELETONS = ASSETS / "skeletons.json"
STUDIO = ASSETS / "studio.toml"
