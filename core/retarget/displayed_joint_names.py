"""Joint names as shown in panels and written for other programs."""

from dataclasses import replace

from ..body.motion import Motion
from ..body.standard_skeleton import JOINT_NAMES, TABLES, facts_of
from ..errors import SettingsError

OWN = "cmu"  # names of the CMU Motion Capture Database, which the standard skeleton uses
BLENDER = "blender"  # names of new characters in Blender

NAMINGS: dict[str, dict[str, str]] = {
    OWN: {name: name for name in JOINT_NAMES},
    **{
        program: {joint: facts_of(joint)[program].format(side=sides.get(joint[0])) for joint in JOINT_NAMES}
        for program, sides in TABLES["sides"].items()
    },
}


def naming_of(name: str) -> dict[str, str]:
    """Return joint -> name in a naming scheme; SettingsError if the scheme is unknown."""
    if name not in NAMINGS:
        raise SettingsError(f"there is no naming scheme {name!r}", advice="choose one of " + ", ".join(NAMINGS))
    return NAMINGS[name]


def rename_joints(motion: Motion, naming: str) -> Motion:
    """Return a motion with its joints renamed."""
    names = naming_of(naming)
    skeleton = motion.skeleton
    return replace(motion, skeleton=replace(skeleton, names=tuple(names[name] for name in skeleton.names)))
