"""Options for the performer and the markers worn, and reading of the files they name."""

import argparse
from typing import Any

from ..api.take_reading import skeleton_subject, wearing
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.subject import Subject, load_subject
from .options import add_text


def add_body_options(parser: argparse.ArgumentParser, subject: str, skeleton: str) -> None:
    """Add --subject and --skeleton, which exclude each other; the arguments describe them."""
    body = parser.add_mutually_exclusive_group()
    add_text(body, "--subject", "FILE", subject)
    add_text(body, "--skeleton", "FILE", skeleton)


def add_names_option(parser: Any) -> None:
    """Add --names, a file that says which marker each label means."""
    parser.add_argument(
        "--names",
        metavar="FILE",
        help='TOML file with a table [names] from label to marker ("Knee 1" = "LKNE"); other labels match '
        "markers of the same name, ignoring case, separators and a subject prefix",
    )


def chosen_marker_set(args: argparse.Namespace) -> MarkerSet | None:
    """Return the marker set of --marker-set, or None if the subject's own is worn."""
    return load_marker_set(args.marker_set) if args.marker_set is not None else None


def chosen_subject(args: argparse.Namespace, marker_set: MarkerSet | None) -> Subject | None:
    """Return the performer of --subject, or of --skeleton with a marker set; None if neither is given."""
    if args.skeleton is not None:
        return skeleton_subject(args.skeleton, marker_set)
    return wearing(load_subject(args.subject), marker_set, args.subject) if args.subject is not None else None
