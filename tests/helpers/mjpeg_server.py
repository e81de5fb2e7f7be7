"""A network camera that can stall or be cut off: MJPEG by HTTP on loopback."""

import socket
import threading
from collections.abc import Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Self

import cv2
from perfanim.core.geometry.arrays import Image


class MjpegServer:
    """A camera that shows images in turn to any number of clients until `close`.

    Args:
        images: (height, width, 3) uint8.
        fps: images a second.

    Attributes:
        address: what to open.
        opened: how often it was.
    """

    def __init__(self, images: Sequence[Image], fps: float) -> None:
        self.opened = 0
        self._encoded = [cv2.imencode(".jpg", image)[1].tobytes() for image in images]
        self._period_s = 1.0 / fps
        self._flows = threading.Event()
        self._ends = threading.Event()
        self._flows.set()
        self._connections: list[socket.socket] = []
        camera = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                camera._serve(self)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_port}/camera.mjpg"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def begin(self, fault: str) -> None:
        """Give nothing and answer nobody from now on; "cut" ends the connections too."""
        self._flows.clear()
        for connection in self._connections if fault == "cut" else ():
            with suppress(OSError):  # its other end was first
                connection.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        """Give images again."""
        self._flows.set()

    def close(self) -> None:
        """End."""
        self._ends.set()
        self.mend()
        self._server.shutdown()
        self._server.server_close()

    def _serve(self, handler: BaseHTTPRequestHandler) -> None:
        self.opened += 1
        self._connections.append(handler.connection)
        with suppress(OSError):  # who asked has gone
            self._flows.wait()
            handler.send_response(200)
            handler.send_header("Content-Type", "multipart/x-mixed-replace; boundary=image")
            handler.end_headers()
            number = 0
            while not self._ends.wait(self._period_s):
                self._flows.wait()
                image = self._encoded[number % len(self._encoded)]
                head = f"--image\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
                handler.wfile.write(head.encode() + image + b"\r\n")
                number += 1
