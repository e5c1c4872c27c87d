"""A page in the browser that shows the newest picture: on this machine, or on a telephone beside the lens."""

import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from rigctl.errors import ConfigError

_PAGE = (
    b"<!DOCTYPE html><title>rigctl preview</title><meta name=viewport content='width=device-width'>"
    b"<body style='margin:0;background:#222'><img src='/stream' style='width:100%;image-rendering:pixelated'></body>"
)
_PART = "rigctl-part"
_WAIT_S = 1.0


class PreviewPage:
    """Serves the page until its context is left.

    Parameters
    ----------
    host : str
        Address of this machine to listen at; 127.0.0.1 is for this machine alone.
    port : int
        0: any that is free.

    Raises
    ------
    ConfigError
        Nothing can listen there.
    """

    def __init__(self, host: str, port: int) -> None:
        self._newest = _Newest()
        try:
            self._server = _Server((host, port), _Handler, self._newest)
        except OSError as error:
            raise ConfigError(f"--listen {host}:{port}: {error.strerror}; name another port") from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="preview page", daemon=True)

    def __enter__(self) -> "PreviewPage":
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._newest.end()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def address(self) -> str:
        """Address to type into the browser."""
        host, port = self._server.server_address[:2]
        return f"http://{host!s}:{port}/"

    def show(self, jpeg: bytes) -> None:
        """Show this picture from now on."""
        self._newest.put(jpeg)


class _Newest:
    """The newest picture, for all who look."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._jpeg, self._number = b"", 0
        self.is_over = False

    def put(self, jpeg: bytes) -> None:
        with self._changed:
            self._jpeg, self._number = jpeg, self._number + 1
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self.is_over = True
            self._changed.notify_all()

    def after(self, number: int) -> tuple[bytes, int]:
        """Return the newest picture and its number, once there is one after that number or the wait is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > number or self.is_over, timeout=_WAIT_S)
            return self._jpeg, self._number


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, place: tuple[str, int], handler: type[BaseHTTPRequestHandler], newest: _Newest) -> None:
        self.newest = newest
        super().__init__(place, handler)


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        if self.path == "/":
            self._answer("text/html", _PAGE)
        elif self.path == "/picture.jpg":
            self._answer("image/jpeg", self.server.newest.after(0)[0])
        elif self.path == "/stream":
            self._stream()
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Say nothing: the terminal is for the numbers."""

    def _answer(self, kind: str, content: bytes) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        """Send picture after picture; each takes the place of the one before."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_PART}")
        self.end_headers()
        number = 0
        try:
            while not self.server.newest.is_over:
                jpeg, newest = self.server.newest.after(number)
                if newest == number:
                    continue
                number = newest
                head = f"--{_PART}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")
        except OSError:
            self.close_connection = True  # whoever looked has gone
