"""Write a character with Mixamo's names of bones to a glTF file.

python -m walks.own_character hero.glb
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))

import bpy
from heroes import save_hero


def main(arguments: list[str]) -> int:
    """Write it, with a .blend beside it."""
    target = Path(arguments[0])
    save_hero(target.with_suffix(".blend"))
    bpy.ops.export_scene.gltf(filepath=str(target))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
