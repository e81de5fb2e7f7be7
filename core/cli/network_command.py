"""`perfanim network get`: the network that finds people without markers."""

import argparse
from pathlib import Path
from typing import Any

from ..system.progress import Progress
from .options import add_command, add_group, add_text


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "network", "get the network that finds people without markers")
    get = add_command(group, "get", run, "get it with pip, or from a file")
    source = "the network (.tflite), a wheel of MediaPipe, or a folder with one (default: download the wheel with pip)"
    add_text(get, "--from", "FILE|DIR", source, dest="source", type=Path)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..api.body_network import get_body_network

    path = get_body_network(args.source, progress)
    return {"network": str(path), "bytes": path.stat().st_size}
