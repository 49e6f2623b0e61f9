"""The web viewer's page as this machine serves it: rerun's own, forbidden to call any other host.

rerun's page loads a font from outside, and the viewer reports usage and looks for news. The links
are removed from the page, and a content security policy makes the browser refuse what the viewer
tries by itself.
"""

from __future__ import annotations

import re
import shutil
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_OUTSIDE_LINK = re.compile(rb"<link\b[^>]*https?://[^>]*>", re.DOTALL)
_COPIED = ("Content-Type", "rerun-final-length")
_TIMEOUT = 30.0  # [s]


@contextmanager
def front(host: str, port: int, *, behind: int, data_port: int) -> Iterator[None]:
    """Serve rerun's web server, on port `behind` of the same host, at `port`.

    data_port : from which the page may fetch data.
    """
    policy = (
        "default-src 'self' data: blob:; "
        f"connect-src 'self' data: blob: http://{host}:{data_port} http://localhost:{data_port}; "
        "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
        "style-src 'self' 'unsafe-inline'; worker-src 'self' blob:"
    )
    server = ThreadingHTTPServer((host, port), partial(_Page, f"http://{host}:{behind}", policy))
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()


class _Page(BaseHTTPRequestHandler):
    def __init__(self, behind: str, policy: str, *rest: object) -> None:
        self._behind, self._policy = behind, policy
        super().__init__(*rest)  # type: ignore[arg-type]  # as socketserver hands them over

    def do_GET(self) -> None:
        """A file of rerun's, or an error of its own."""
        try:
            answer = urllib.request.urlopen(self._behind + self.path, timeout=_TIMEOUT)
        except urllib.error.HTTPError as error:
            self.send_error(error.code)
            return
        except OSError:
            self.send_error(502)
            return
        with answer:
            self.send_response(200)
            for name in _COPIED:
                if value := answer.headers.get(name):
                    self.send_header(name, value)
            self.send_header("Content-Security-Policy", self._policy)
            self.send_header("Referrer-Policy", "no-referrer")
            html = answer.headers.get_content_type() == "text/html"
            page = _OUTSIDE_LINK.sub(b"", answer.read()) if html else b""
            length = str(len(page)) if html else answer.headers.get("Content-Length")
            if length:
                self.send_header("Content-Length", length)
            self.end_headers()
            if html:
                self.wfile.write(page)
            else:
                shutil.copyfileobj(answer, self.wfile)

    def log_message(self, *_: object) -> None:
        """Nothing: the terminal shows the address and no more."""
