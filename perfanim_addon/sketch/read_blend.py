"""Reading the sketch in a .blend file without a window, for `perfanim sketch`.

    python -m perfanim.perfanim_addon.sketch.read_blend FILE.blend

Run it in a separate process: it opens another scene, without running its scripts. The last line on stdout is a JSON
object.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.errors import PerfanimError, SettingsError
from ...core.markers.subject import skeleton_table
from ...core.system.schema import table_of
from ..character.bone_map_settings import PERFANIM_PG_character, PERFANIM_PG_joint
from ..export.retarget_file import open_file
from ..preferences.property_kinds import attach
from ..settings.sketch_settings import PERFANIM_PG_sketch
from .controls import controls_of
from .read_controls import read_controls
from .write_solution import SketchBody


def read_blend(path: Path) -> dict[str, Any]:
    """Return skeleton and sketch of the character with controls; SettingsError unless there is exactly one."""
    open_file(path)
    found = [obj for obj in bpy.context.scene.objects if obj.type == "ARMATURE" and controls_of(obj)]
    if len(found) != 1:
        advice = "keep the controls of one character" if found else "add controls to its character, and key them"
        names = f"sketches of {', '.join(each.name for each in found)}" if found else "no sketch"
        raise SettingsError(f"has {names}", where=str(path), advice=advice)
    body = SketchBody.of(found[0])
    sketch = read_controls(bpy.context, found[0], body.space)
    return {"skeleton": skeleton_table(body.skeleton), "sketch": table_of(sketch)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 1 with one line on stderr if the input was bad."""
    (path,) = sys.argv[1:] if arguments is None else arguments
    for group in (PERFANIM_PG_joint, PERFANIM_PG_character, PERFANIM_PG_sketch):
        bpy.utils.register_class(group)
        if hasattr(group, "attached_to"):
            attach(group)
    try:
        found = read_blend(Path(path))
    except PerfanimError as error:
        sys.stderr.write(f"read_blend: {' '.join(str(error).split())}\n")
        return 1
    sys.stdout.write("\n" + json.dumps(found, default=np.ndarray.tolist) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
