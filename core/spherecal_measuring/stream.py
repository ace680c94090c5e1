"""Measured sets as JSON lines over TCP, on 127.0.0.1 alone (docs/measuring.md); slow clients are dropped."""

import contextlib
import json
import queue
import socket
import threading
from collections.abc import Mapping
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

HOST = "127.0.0.1"
FORMAT = "spherecal/measurements"
VERSION = 1
MOST_CLIENTS = 8
# Six seconds at 10 Hz. A set of 60 targets is 20 KB: at most 1.3 MB a client.
QUEUE_LINES = 64
_SEND_S = 2.0  # a client whose system takes nothing for so long is dropped too
_AGAIN_S = 0.5  # after a client could not be accepted
_ACCEPT_S = 0.2  # between looks at whether to end


class _Client:
    """One connection with its queue and the thread that empties it."""

    def __init__(self, connection: socket.socket, hello: bytes, queue_lines: int) -> None:
        self._connection = connection
        self._lines: queue.Queue[bytes | None] = queue.Queue(queue_lines)
        self._lines.put_nowait(hello)
        self.alive = True
        self._thread = threading.Thread(target=self._run, name="stream client", daemon=True)
        self._thread.start()

    def send(self, line: bytes) -> None:
        """Queue a line; the client is dropped where the queue is full."""
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            self.drop()

    def drop(self) -> None:
        """End the connection at once."""
        self.alive = False
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()

    def finish(self, seconds: float) -> None:
        """Send what is queued, for at most so long, then end."""
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(None)
        self._thread.join(seconds)
        self.drop()

    def _run(self) -> None:
        self._connection.settimeout(_SEND_S)
        with contextlib.suppress(OSError):
            while self.alive and (line := self._lines.get()) is not None:
                self._connection.sendall(line)
        self.alive = False


class MeasurementStream(contextlib.AbstractContextManager["MeasurementStream"]):
    """Listens on 127.0.0.1 from the moment it is made; use it in a `with` block."""

    def __init__(self, port: int, about: Mapping[str, Any] | None = None, queue_lines: int = QUEUE_LINES) -> None:
        if not 0 <= port <= 65535:
            raise InputError(Phrase("error-no-port", {"port": port}))
        self._hello = _line({"format": FORMAT, "version": VERSION, **(about or {})})
        self._queue_lines = queue_lines
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows: nobody else may listen on the same port
                self._server.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
            else:
                self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind((HOST, port))
            self._server.listen(MOST_CLIENTS)
        except OSError as error:
            self._server.close()
            why = (error.strerror or str(error)).lower()
            raise InputError(Phrase("error-port-taken", {"port": port, "host": HOST, "why": why})) from None
        self.port = int(self._server.getsockname()[1])
        self._server.settimeout(_ACCEPT_S)
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._end = threading.Event()
        self.dropped = 0
        self._thread = threading.Thread(target=self._accept, name="stream", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """How many are connected."""
        with self._lock:
            return sum(client.alive for client in self._clients)

    def send(self, document: Mapping[str, Any]) -> None:
        """Give a document to all clients; never waits."""
        with self._lock:
            if not self._clients:
                return
            line = _line(document)
            for client in self._clients:
                client.send(line)
            gone = [client for client in self._clients if not client.alive]
            self.dropped += len(gone)
            self._clients = [client for client in self._clients if client.alive]

    def close(self, seconds: float = 1.0) -> None:
        """Let clients have what is queued, for at most `seconds` each, and end."""
        self._end.set()
        self._thread.join()
        self._server.close()
        with self._lock:
            for client in self._clients:
                client.finish(seconds)
            self._clients = []

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        while not self._end.is_set():
            try:
                connection, _ = self._server.accept()
            except TimeoutError:
                continue
            except OSError:
                if self._end.wait(_AGAIN_S):  # too many files are open, or the client has gone
                    return
                continue
            with self._lock:
                if sum(client.alive for client in self._clients) >= MOST_CLIENTS:
                    connection.close()
                else:
                    self._clients.append(_Client(connection, self._hello, self._queue_lines))


def _line(document: Mapping[str, Any]) -> bytes:
    return (json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n").encode()
