"""Options that several commands share, and the types of their values."""

import argparse
from collections.abc import Iterable
from functools import partial
from typing import Any, TypeVar

from ..errors import SettingsError
from ..retarget.displayed_joint_names import NAMINGS, OWN
from ..retarget.retargeter import RootMotion
from ..system.schema import keys_of

_T = TypeVar("_T")


def add_text(parser: Any, flag: str, metavar: str, description: str, **more: Any) -> None:
    """Add an option with a value, a string unless `type` is given."""
    parser.add_argument(flag, metavar=metavar, help=description, **more)


def add_number(parser: Any, flag: str, metavar: str, description: str, **more: Any) -> None:
    """Add an option with a number."""
    add_text(parser, flag, metavar, description, type=float, **more)


def add_repeated(parser: Any, flag: str, metavar: str, description: str) -> None:
    """Add an option that may be given any number of times; its values form a list."""
    add_text(parser, flag, metavar, description, action="append", default=[])


def add_choice(parser: Any, flag: str, choices: Iterable[str], description: str, **more: Any) -> None:
    """Add an option that takes one of several words."""
    parser.add_argument(flag, choices=tuple(choices), help=description, **more)


def add_switch(parser: Any, flag: str, description: str) -> None:
    """Add a switch."""
    parser.add_argument(flag, action="store_true", help=description)


def add_request_options(parser: Any, request: type, **flags: str) -> None:
    """Add options for fields of a request; meaning and default come from the fields.

    Args:
        flags: Option and metavar for each field: smooth_hz="--smooth HZ". The option's value has the field's name.
    """
    parser.set_defaults(flags={field: flag.partition(" ")[0] for field, flag in flags.items()})
    for key in keys_of(request):
        if key.field not in flags:
            continue
        flag, _, metavar = flags[key.field].partition(" ")
        is_shown = key.optional and key.default not in (None, (), False)
        text = f"{key.about.text} (default {key.default})" if is_shown else key.about.text
        more: dict[str, Any] = {"dest": key.field, "help": text, "required": not key.optional}
        if bool in key.holds:
            more["action"] = "store_true"
        elif key.choices:
            more |= {"choices": key.choices, "default": key.default}
        else:
            more |= {"type": key.holds[0], "metavar": metavar, "nargs": "+" if key.is_list else None}
            more |= {"default": key.default} if key.optional else {}
        parser.add_argument(flag, **more)


def request_of(request: type[_T], args: argparse.Namespace, **more: Any) -> _T:
    """Return the request from options added by `add_request_options` and from further fields.

    Raises:
        SettingsError: A value is out of range; the message names its option.
    """
    given = {key.field: getattr(args, key.field) for key in keys_of(request) if hasattr(args, key.field)}
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    try:
        return request(**given | more)
    except SettingsError as error:
        field, _, fact = error.what.partition(" ")
        raise SettingsError(f"{args.flags.get(field, field)} {fact}") from error


def add_command(group: Any, name: str, run: Any, description: str) -> argparse.ArgumentParser:
    """Add a command to a group and return its parser; `run` receives the options and the progress."""
    parser: argparse.ArgumentParser = group.add_parser(name, help=description)
    parser.set_defaults(run=run, wrong_usage=parser.error)
    return parser


def add_group(subparsers: Any, name: str, description: str) -> Any:
    """Add a command that has subcommands, and return their group."""
    return subparsers.add_parser(name, help=description).add_subparsers(metavar="WHAT", required=True)


def seed(text: str) -> int:
    """Return a seed, a whole number from 0."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or greater")
    return number


def positive(text: str, most: float, unit: str) -> float:
    """Return a number above 0, up to `most`; `unit` appears in the error."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not above 0 and at most {most:g} {unit}")
    return number


rate_hz = partial(positive, most=1000.0, unit="frames per second")


def check_range(option: str, value: float | None, least: float, most: float, advice: str) -> None:
    """Raise SettingsError for an option's value that is out of range."""
    if value is not None and not least <= value <= most:
        raise SettingsError(f"{option} {value:g} is out of range", advice=advice)


def check_fps(fps: float | None) -> None:
    """Raise SettingsError for a --fps that is out of range."""
    check_range("--fps", fps, 1.0, 1000.0, "give 1 to 1000 frames per second")


def check_height(height_m: float | None) -> None:
    """Raise SettingsError for a --height that no adult has."""
    check_range("--height", height_m, 1.0, 2.5, "give metres, 1 to 2.5")


def add_motion_options(parser: Any, *, defaults: bool = True) -> None:
    """Add the options for writing a motion file, see `write_motion`; without `defaults`, options not given are None."""
    units, naming = ("m", OWN) if defaults else (None, None)
    add_choice(parser, "--units", ("m", "cm"), "unit of a BVH file (default m)", default=units)
    names = f"names of the joints in BVH and CSV files (default {OWN}: the standard skeleton's)"
    add_choice(parser, "--naming", NAMINGS, names, default=naming)
    add_text(parser, "--rate", "HZ", "frames per second of the motion (default: as it was recorded)", type=rate_hz)


def add_character_options(parser: Any, root_motion: str | None = "hips") -> None:
    """Add the options for retargeting a motion to a character; `root_motion` is the default of --root-motion."""
    add_text(parser, "--map", "PRESET_OR_FILE", "bone map: rigify-controls or a TOML file (default: detected)")
    carriers = [kind.name.lower().replace("_", "-") for kind in RootMotion]
    carrier = "bone or object that receives the root motion (default hips)"
    add_choice(parser, "--root-motion", carriers, carrier, default=root_motion)
    add_text(parser, "--blender", "FILE", "Blender executable (default: the Python module bpy)")


def add_source_options(parser: Any, source: str) -> None:
    """Add options for the calibration and for each camera's images, which `source` describes."""
    add_text(parser, "--cameras", "cameras.toml", "the calibration", required=True)
    add_text(parser, "--left", "SRC", source, required=True)
    add_text(parser, "--right", "SRC", "the same for the right camera", required=True)
    add_repeated(parser, "--camera", "SRC", "any further camera, in the calibration's order")
