"""Another version of the product, solving the same takes by its own command line."""

import os
import subprocess
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from perfanim.core.body.motion import Motion
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_take import MarkerTake

from .data import CMU, FPS, SPLIT, SPLIT_AT, data_folders

_MAIN = "import sys; from perfanim.core.cli.main import main; sys.exit(main())"


class Baseline:
    """A checkout of another commit, with databases that it builds itself.

    Args:
        checkout: its folder.
        data: folder that holds cmu/ and bandai/.
        out: folder for its databases and results.
    """

    def __init__(self, checkout: Path, data: Path, out: Path) -> None:
        self._data, self._out = data, out
        self._checkout = checkout.resolve()
        self._path = out / "package"
        self._path.mkdir(parents=True, exist_ok=True)
        link = self._path / "perfanim"
        link.unlink(missing_ok=True)
        link.symlink_to(self._checkout, target_is_directory=True)

    def database(self, name: str, trials: Collection[str], sets: tuple[str, ...] = (CMU,)) -> Path:
        """Return its database of the sets' trials, the split take cut, built if missing."""
        path = self._out / f"{name}.pfdb"
        if path.exists():
            return path
        folder = self._out / name
        with motion_files(data_folders(self._data, sets)) as files:
            for file in files:
                if file.stem in trials:
                    paths = [file.path] + ([file.skeleton] if file.skeleton else [])
                    _lay(paths, folder / file.path.parent.name)
        self.run("database", "build", str(folder), "--out", str(path), "--fps", f"{FPS:g}")
        return path

    def embedded_database(self) -> Path:
        """Return the database of the motion that comes with it, built if missing."""
        path = self._out / "embedded.pfdb"
        if not path.exists():
            self.run(
                "database", "build", str(self._checkout / "assets" / "motion"), "--out", str(path), "--fps", f"{FPS:g}"
            )
        return path

    def solve(self, take: MarkerTake, skeleton: Path, marker_set: str, database: Path) -> Motion:
        """Return its solution of a take for the body of a skeleton's file."""
        body = ("--skeleton", str(skeleton), "--marker-set", marker_set)
        with TemporaryDirectory(dir=self._out) as folder:  # of its own: several processes solve
            markers, motion = Path(folder) / "take.take.npz", Path(folder) / "solved.bvh"
            write_take(take, markers)
            self.run("solve", str(markers), *body, "--database", str(database), "--out", str(motion))
            return read_motion(motion)

    def run(self, *arguments: str) -> str:
        """Return the output of one of its commands, or raise FormatError."""
        environment = os.environ | {"PYTHONPATH": str(self._path), "OPENBLAS_NUM_THREADS": "1"}
        # in the folder of the results: the present one may hold another package of that name
        done = subprocess.run(
            [sys.executable, "-P", "-c", _MAIN, *arguments],
            cwd=self._out,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise FormatError(
                f"`perfanim {arguments[0]}` failed ({done.stderr.strip()[-200:]})",
                where=str(self._checkout),
                advice="give a checkout with a working command line with --baseline",
            )
        return done.stdout


def _lay(paths: Sequence[Path], folder: Path) -> None:
    """Put a motion file and its skeleton into a folder, the split take cut."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in paths:
        target = folder / path.name
        if target.exists():
            continue
        if path.name == f"{SPLIT}.amc":
            target.write_text(_first_share(path.read_text(encoding="utf-8")), encoding="utf-8")
        else:
            target.symlink_to(path.resolve())


def _first_share(amc: str) -> str:
    """Return the text of an AMC file up to where its test part begins."""
    lines = amc.splitlines(keepends=True)
    frames = [index for index, line in enumerate(lines) if line.strip().isdigit()]
    return "".join(lines[: frames[int(len(frames) * SPLIT_AT)]])
