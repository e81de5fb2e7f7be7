"""Program: takes the poses of a capture as Blender does, until it is killed.

Argument: the request, as JSON. Prints the worker's process id, and a line at the first pose.
"""

import json
import sys
import time

from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import MessageKind


def main(request: str) -> None:
    client = WorkerClient(json.loads(request))
    sys.stdout.write(f"{client.process_id}\n")
    sys.stdout.flush()
    taken = 0
    while not client.ended:
        poses = sum(message.kind is MessageKind.POSE for message in client.poll())
        if poses and not taken:
            sys.stdout.write("capturing\n")
            sys.stdout.flush()
        taken += poses
        client.acknowledge(taken)
        time.sleep(1 / 60)


if __name__ == "__main__":
    main(sys.argv[1])
