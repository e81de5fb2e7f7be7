"""Go through the walks and leave their pages below a folder.

python -m walks --out out/walks [--only developer] [--takes DIR] [--character FILE]
"""

import argparse
import sys
from pathlib import Path

from . import developer, technical_director
from .page import WalkError

WALKS = ("technical-director", "developer")


def main() -> int:
    """Go through the chosen walks; return 1 where one stops."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the pages")
    parser.add_argument("--only", choices=WALKS, help="one of them")
    parser.add_argument("--takes", type=Path, help="folder of C3D takes (default: simulated ones)")
    parser.add_argument("--character", type=Path, help="character (default: the project's own)")
    options = parser.parse_args()
    out = options.out.resolve()
    try:
        if options.only != "developer":
            takes, character = (path and path.resolve() for path in (options.takes, options.character))
            technical_director.walk_through(out / "technical-director", takes, character)
        if options.only != "technical-director":
            developer.walk_through(out / "developer")
    except WalkError as error:
        sys.stdout.write(f"stopped: {error}\n")
        return 1
    sys.stdout.write(f"pages: {out}/*/index.html\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
