"""Job: run a command of the command line for Blender."""

from ...cli.main import COMMANDS, build_parser
from ...cli.output_guard import guarded_run
from ...errors import CaptureError
from ...system.priority import step_back
from ..channel import Channel
from ..requests import CommandRequest


def run(request: CommandRequest, channel: Channel) -> None:
    """Run the command; send progress as STATUS messages and the summary as RESULT."""
    arguments = request.arguments
    if not arguments or arguments[0] not in COMMANDS:
        what = f"received an unknown command: {' '.join(arguments)}"
        raise CaptureError(what, where="worker", advice="restart Blender")
    try:
        options = build_parser(arguments[:1]).parse_args(arguments)
    except SystemExit as error:
        what = f"received invalid options: {' '.join(arguments)}"
        raise CaptureError(what, where="worker", advice="check the settings") from error

    if request.gently:
        step_back()

    def progress(fraction: float, text: str) -> None:
        if channel.stop_requested.is_set():
            raise CaptureError("stopped", where=" ".join(arguments[:2]))
        channel.send_status(text, fraction)

    channel.send_result(guarded_run(options, progress))
