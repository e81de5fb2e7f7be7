"""Go through the walks and leave their pages below a folder.

python -m walks --out out/walks [--only developer] [--takes DIR] [--character FILE] [--webcams DIR]

The animator's needs BLENDER: a command that runs its arguments where a Blender with a window can be started.
"""

import argparse
import os
import sys
from pathlib import Path

from . import animator, developer, technical_director
from .page import WalkError

WALKS = ("animator", "technical-director", "developer")


def main() -> int:
    """Go through the chosen walks; return 1 where one stops."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the pages")
    parser.add_argument("--only", choices=WALKS, help="one of them")
    parser.add_argument("--takes", type=Path, help="folder of C3D takes (default: simulated ones)")
    parser.add_argument(
        "--character", type=Path, help="character, a glTF file for the animator's (default: one made for the walk)"
    )
    parser.add_argument(
        "--webcams", type=Path, help="folder with sequence4 and stereo_calibration.json (default: simulated)"
    )
    options = parser.parse_args()
    out = options.out.resolve()
    takes, character, webcams = (
        path and path.resolve() for path in (options.takes, options.character, options.webcams)
    )
    wanted = (options.only,) if options.only else WALKS
    try:
        if "animator" in wanted and "BLENDER" not in os.environ:
            sys.stdout.write("the animator's walk is left out: BLENDER names no Blender with a window\n")
        elif "animator" in wanted:
            animator.walk_through(out / "animator", webcams, character)
        if "technical-director" in wanted:
            technical_director.walk_through(out / "technical-director", takes, character)
        if "developer" in wanted:
            developer.walk_through(out / "developer")
    except WalkError as error:
        sys.stdout.write(f"stopped: {error}\n")
        return 1
    sys.stdout.write(f"pages: {out}/*/index.html\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
