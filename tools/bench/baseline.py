"""Baseline: another version of the product that solves the same takes with its own command line."""

import os
import shutil
import subprocess
import sys
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from perfanim.core.body.motion import Motion
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.system.progress import no_progress

from .run import Run
from .scenarios import CMU, FPS, SPLIT, SPLIT_AT

_MAIN = "import sys; from perfanim.core.cli.main import main; sys.exit(main())"


class Baseline:
    """A checkout of another commit, with databases that it builds itself.

    Args:
        checkout: Folder of the checkout.
        run: Run whose motion it reads.
        name: Folder for its databases and results, inside the run's.
    """

    def __init__(self, checkout: Path, run: Run, name: str = "baseline") -> None:
        self._run = replace(run, progress=no_progress)  # another process may read it
        self._out, self._checkout = run.out / name, checkout.resolve()
        self._out.mkdir(parents=True, exist_ok=True)

    def database(self, name: str, trials: Collection[str], folder: str = CMU) -> Path:
        """Return its database of trials, without the test part of the split take; it is built if missing."""
        if not (path := self._out / f"{name}.pfdb").exists():
            with motion_files(self._run.folders((folder,))) as files:
                for file in files:
                    if file.stem in trials:
                        for part in filter(None, (file.path, file.skeleton)):
                            _lay(part, self._out / name / file.path.parent.name)
            self._build(self._out / name, path)
        return path

    def embedded_database(self) -> Path:
        """Return the database of the motion that comes with it; it is built if missing."""
        if not (path := self._out / "embedded.pfdb").exists():
            self._build(self._checkout / "assets" / "motion", path)
        return path

    def _build(self, folder: Path, path: Path) -> None:
        self.call("database", "build", str(folder), "--out", str(path), "--fps", f"{FPS:g}")

    def solve(
        self, take: MarkerTake, skeleton: Path, marker_set: str, database: Path, prior: Path | None, causal: bool
    ) -> Motion:
        """Return its solution of a take for the body in a skeleton file.

        Args:
            prior: File of the learned prior in place of its own, which may have seen the performer; None for none.
            causal: Solve each frame from itself and earlier ones, as live.
        """
        options = ("--skeleton", str(skeleton), "--marker-set", marker_set, *(("--causal",) if causal else ()))
        with TemporaryDirectory(dir=self._out) as folder:  # a separate folder, because several processes solve
            markers, motion = Path(folder) / "take.take.npz", Path(folder) / "solved.bvh"
            write_take(take, markers)
            files = ("--database", str(database), "--out", str(motion))
            self._run_main(self._with_prior(prior), "solve", str(markers), *options, *files)
            return read_motion(motion)

    def call(self, *arguments: str) -> str:
        """Return the output of one of its commands, with its own prior; FormatError if it fails."""
        return self._run_main(self._with_prior(self._checkout / "assets" / "motion_prior.npz"), *arguments)

    def _with_prior(self, prior: Path | None) -> Path:
        """Return the folder of a copy of its package that has this prior."""
        path = self._out / "packages" / (prior.stem if prior else "no prior")
        if path.exists():
            return path
        path.parent.mkdir(exist_ok=True)
        with TemporaryDirectory(dir=self._out) as folder:  # renamed when complete, because several processes solve
            copied = Path(folder) / "package"
            for part in ("core", "assets"):
                hidden = shutil.ignore_patterns("__pycache__", "motion_prior.npz")
                shutil.copytree(self._checkout / part, copied / "perfanim" / part, ignore=hidden)
            shutil.copy(self._checkout / "__init__.py", copied / "perfanim")
            if prior:
                shutil.copy(prior, copied / "perfanim" / "assets" / "motion_prior.npz")
            with suppress(OSError):  # another process was faster
                copied.rename(path)
        return path

    def _run_main(self, package: Path, *arguments: str) -> str:
        environment = os.environ | {"PYTHONPATH": str(package), "OPENBLAS_NUM_THREADS": "1"}
        # run in the folder of the results, because the current one may contain another package of that name
        command = [sys.executable, "-P", "-c", _MAIN, *arguments]
        done = subprocess.run(command, cwd=self._out, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise FormatError(
                f"`perfanim {arguments[0]}` failed ({done.stderr.strip()[-200:]})",
                where=str(self._checkout),
                advice="give a checkout with a working command line with --baseline",
            )
        return done.stdout


def _lay(path: Path, folder: Path) -> None:
    """Put a file into a folder; of the split take only the part before its test part."""
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / path.name
    if target.exists():
        return
    if path.name == f"{SPLIT}.amc":
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        frames = [index for index, line in enumerate(lines) if line.strip().isdigit()]
        target.write_text("".join(lines[: frames[int(len(frames) * SPLIT_AT)]]))
    else:
        target.symlink_to(path.resolve())
