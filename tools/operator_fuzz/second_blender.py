"""A second Blender that uses the first one's folders: `second_blender.py FOLDER SEED`.

It switches the add-on on, lists the takes, changes one, and switches the add-on off.
"""

import random
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))

import addon_utils  # comes with `bpy`
from extension_folder import MODULE, find_extension


def main(folder: Path, seed: str) -> None:
    """Do the work; `folder` is the extensions folder."""
    chance = random.Random(seed)  # noqa: S311 - repeatable, no secret
    if MODULE not in bpy.context.preferences.addons:  # as a module, it does not know the first one's preferences
        find_extension(folder)
        addon_utils.enable(MODULE, default_set=True)
    library = sys.modules[f"{MODULE}.perfanim_addon.take_library"]
    takes = [take.path for take in library.listed()]
    trash = library.in_trash()
    kind = chance.choice(("delete", "restore", "empty", "play", "look"))
    if takes and kind == "delete":
        library.delete(chance.choice(takes))
    elif trash and kind == "restore":
        library.restore(chance.choice(trash))
    elif kind == "empty":
        library.remove(trash)
    elif takes and kind == "play":
        library.mark_played(chance.choice(takes), "Character")
    library.forget()
    left = {path.name for path in library.folder().glob("*.perftake")}
    sys.stdout.write(f"second Blender: {kind}, {len(left)} takes\n")
    addon_utils.disable(MODULE)


if __name__ == "__main__":
    main(Path(sys.argv[-2]), sys.argv[-1])
