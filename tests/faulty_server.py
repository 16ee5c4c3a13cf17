"""A local HTTP server with the faults that real ones have."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Served:
    """A file and how the server misbehaves with it; the lists are used up, an entry a request."""

    content: bytes
    etag: str | None = None
    modified: str | None = None
    ranges: bool = True
    length: int | str | None = None  # Content-Length to announce in place of the true one; "" for none
    cuts: list[int | None] = field(default_factory=list)  # bytes after which the connection is closed
    answers: list[int] = field(default_factory=list)  # statuses before it works
    redirect: str | None = None
    delay: float = 0.0  # seconds before the answer
    stall: bool = False  # send half, then nothing
    headers: dict[str, str] = field(default_factory=dict)
    chunked: bool = False
    shift: int = 0  # added to the start of a range that is answered


class Server(ThreadingHTTPServer):
    """Serves `files` by path and remembers what was asked for."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.files: dict[str, Served] = {}
        self.asked: list[tuple[str, str | None]] = []  # path, Range
        self.released = threading.Event()

    def address(self, path: str) -> str:
        return f"http://127.0.0.1:{self.server_port}{path}"

    def put(self, path: str, content: bytes, **how: Any) -> Served:
        self.files[path] = Served(content, **how)
        return self.files[path]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is part of the tests."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def log_message(self, format: str, *args: Any) -> None:
        pass

    def do_GET(self) -> None:
        self.close_connection = True
        asked = self.headers.get("Range")
        self.server.asked.append((self.path, asked))
        served = self.server.files.get(self.path)
        if served is None:
            self.answer(404)
            return
        time.sleep(served.delay)
        if served.answers:
            self.answer(served.answers.pop(0), {"Retry-After": "0"})
            return
        if served.redirect is not None:
            self.answer(302, {"Location": served.redirect})
            return
        content, total = served.content, len(served.content)
        headers = dict(served.headers)
        if served.etag:
            headers["ETag"] = served.etag
        if served.modified:
            headers["Last-Modified"] = served.modified
        status, start = 200, 0
        condition = self.headers.get("If-Range")
        if asked and served.ranges and condition in (None, served.etag, served.modified):
            start = int(asked.removeprefix("bytes=").removesuffix("-"))
            if start >= total:
                self.answer(416, {"Content-Range": f"bytes */{total}"})
                return
            status = 206
            headers["Content-Range"] = f"bytes {start + served.shift}-{total - 1}/{total}"
        body = content[start:]
        if served.chunked:
            headers["Transfer-Encoding"] = "chunked"
        elif served.length != "":
            headers["Content-Length"] = str(len(body) if served.length is None else served.length)
        self.send(status, headers)
        cut = served.cuts.pop(0) if served.cuts else None
        if served.chunked:
            for i in range(0, len(body), 1000):
                if cut is not None and i >= cut:
                    return
                block = body[i : i + 1000]
                self.wfile.write(f"{len(block):x}\r\n".encode() + block + b"\r\n")
            self.wfile.write(b"0\r\n\r\n")
            return
        self.wfile.write(body[: len(body) // 2] if served.stall else body[:cut])
        if served.stall:
            self.wfile.flush()
            self.server.released.wait(10)

    def answer(self, status: int, headers: dict[str, str] | None = None) -> None:
        self.send(status, {"Content-Length": "0", **(headers or {})})

    def send(self, status: int, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()


@contextlib.contextmanager
def serving() -> Iterator[Server]:
    """A server that runs until the end."""
    server = Server()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        server.released.set()
        server.shutdown()
        thread.join()
        server.server_close()
