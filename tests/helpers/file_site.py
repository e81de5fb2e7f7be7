"""A file server on loopback, and an archive of motion for it."""

import functools
import http.server
import tarfile
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from perfanim.core.system.assets import MOTION

_PIECE = 1 << 14  # bytes


class _Quiet(http.server.SimpleHTTPRequestHandler):
    pause_s = 0.0

    def copyfile(self, source: Any, outputfile: Any) -> None:
        """Send a file in pieces, with a pause after each; the other side may be gone."""
        with suppress(ConnectionError):
            while piece := source.read(_PIECE):
                outputfile.write(piece)
                time.sleep(self.pause_s)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def serving(folder: Path, pause_s: float = 0.0) -> Iterator[str]:
    """Yield the address of a server of the files in a folder, with a pause after each 16 kB."""
    handler = functools.partial(type("_Paced", (_Quiet,), {"pause_s": pause_s}), directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def motion_archive(path: Path) -> Path:
    """Write an archive of two clips, of the kind that its name says."""
    files = sorted(MOTION.glob("*.bvh"))[:2]
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as opened:
            for file in files:
                opened.write(file, file.name)
    else:
        with tarfile.open(path, "w" if path.suffix == ".tar" else "w:gz") as packed:
            for file in files:
                packed.add(file, file.name)
    return path
