"""Batch tasks on the machines of a Dask cluster, one task per take."""

from collections.abc import Callable, Generator, Sequence

from ...errors import SettingsError
from .take_record import Record, Task, failed_record

_CONNECT_S = 30.0


def on_cluster(address: str, serve: Callable[[str], str], tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Yield the records of tasks as they finish.

    Args:
        address: Address of the scheduler, e.g. tcp://host:8786. All workers need this package and the same file paths.
        serve: Function that processes one task, JSON in and out; the workers import it by name.
        tasks: Tasks in the order in which they are started.

    Raises:
        SettingsError: Dask is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise SettingsError(
            "Dask is not installed", where="--scheduler", advice="pip install 'perfanim[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise SettingsError(
            "no Dask scheduler answers there", where=address, advice="start one with `dask scheduler`"
        ) from error
    with client:
        # the priority keeps the order; a task is not pure, because it writes files
        futures = {
            client.submit(serve, task.text(), pure=False, priority=-number): task for number, task in enumerate(tasks)
        }
        for future in as_completed(futures):
            if future.status == "finished":
                yield Record.of_text(future.result())
            else:
                why = repr(future.exception()) if future.status == "error" else future.status
                yield failed_record(futures[future].take, f"the cluster did not process it: {why}")
