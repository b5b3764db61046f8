"""Serves Rerun's web viewer on loopback, under a policy that lets it contact nothing else.

Rerun's own page sends usage data even if its settings forbid it, and its server keeps a core busy while it shows a
file. Here the page's files are taken once from Rerun's program, and plain HTTP serves them beside the recordings.
"""

import base64
import contextlib
import functools
import hashlib
import http.server
import re
import shutil
import socketserver
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from urllib.parse import quote, unquote, urlsplit

from sim.cache import cached_bytes
from sim.errors import RecordingError

from .process import LOOPBACK, WEB_PORT, running_rerun

VIEWER_FILES = ("index.html", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""The files of the web page of rerun 0.41."""
VIEWER = "/viewer/"
"""Path at which the page is served."""
MIME_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".ico": "image/x-icon",
    ".jpg": "image/jpeg",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".md": "text/plain; charset=utf-8",
    ".png": "image/png",
    ".rrd": "application/octet-stream",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
}
"""MIME type by suffix; other files are not served."""
PAGE_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of the pages in a served folder."""
_OUTSIDE_LINK = re.compile(rb"<link\b[^>]*https?://[^>]*>")
_INLINE_SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)
_QUIET = b"<script>console.debug = () => {};</script>"
"""Silences the page's shader compiler, which writes some 17,000 debug lines; a browser under test spent 10 of 18 s on
passing them on."""
_CACHE_VERSION = 2
"""Version of our copies of the viewer's files."""


@dataclass(frozen=True, slots=True)
class WebViewer:
    """A running web server with the viewer and, perhaps, files and a live stream to show."""

    address: str
    """`http://127.0.0.1:PORT`; its `/` is the folder's page, or the viewer with the only recording or stream."""
    live: str | None = None
    """`rerun+http://127.0.0.1:PORT/proxy` of a running stream."""

    def of_file(self, name: str) -> str:
        """Address of the viewer with a served recording; `name` is its path below the folder."""
        return self._viewer(f"{self.address}/{quote(name)}")

    def of_live(self) -> str:
        """Address of the viewer with the live stream."""
        assert self.live is not None
        return self._viewer(self.live)

    def _viewer(self, source: str) -> str:
        return f"{self.address}{VIEWER}?url={quote(source, safe=':/%')}&hide_welcome_screen=1&persist=0"


@contextlib.contextmanager
def serve_folder(folder: Path, *, page: str = "index.html", port: int = 0) -> Iterator[WebViewer]:
    """Serves a folder (`page` at `/`) and the viewer at `/viewer/` until the end of the block.

    A link to a recording opens the viewer with it.

    Args:
        folder: Programs on this machine can read everything below it, except hidden files and links out of it.
        page: The folder's first page.
        port: 0 = a free port.

    Raises:
        RecordingError: The viewer cannot be taken from Rerun's program, or the port is taken.
    """
    with _serve(_Site(folder=folder.resolve(), first=page), port) as address:
        yield WebViewer(address)


@contextlib.contextmanager
def serve_file(path: Path, *, port: int = 0) -> Iterator[WebViewer]:
    """Serves one recording, nothing beside it, and the viewer until the end of the block. Raises like serve_folder."""
    whole = path.resolve()
    with _serve(_Site(folder=whole.parent, only=whole.name), port) as address:
        yield WebViewer(address)


@contextlib.contextmanager
def serve_live(data_port: int, *, port: int = 0) -> Iterator[WebViewer]:
    """Serves the viewer for the stream of a running Rerun server on loopback. Raises like serve_folder."""
    with _serve(_Site(data_port=data_port), port) as address:
        yield WebViewer(address, live=live_url(data_port))


def live_url(data_port: int) -> str:
    """Address of a Rerun server on loopback, to which programs send and from which viewers read."""
    return f"rerun+http://{LOOPBACK}:{data_port}/proxy"


@functools.cache
def viewer_file(name: str) -> bytes:
    """One of VIEWER_FILES, taken from the installed Rerun once and then from the cache folder.

    Raises:
        RecordingError: Rerun's program cannot be started, or serves no such file.
    """
    assert name in VIEWER_FILES, name
    key = f"rerun {version('rerun-sdk')} web viewer {_CACHE_VERSION} {name}"
    return cached_bytes(name.rsplit(".", 1)[1], key, lambda: _taken_files()[name])


@dataclass(frozen=True, slots=True)
class _Site:
    """The files and the stream that a server offers."""

    folder: Path | None = None
    """The resolved folder; None = no files."""
    only: str | None = None
    """The one file of the folder that is served; None = all."""
    first: str = ""
    """The folder's page at `/`."""
    data_port: int | None = None
    """Port of the live stream that the viewer may read."""

    def file(self, path: str) -> Path | None:
        """The served file for a URL's path; None = there is no such file, or it must not be read."""
        parts = PurePosixPath(unquote(path)).parts[1:]
        if self.folder is None or not parts or any(part.startswith(".") or "\\" in part for part in parts):
            return None
        if self.only is not None and parts != (self.only,):
            return None
        try:
            found = self.folder.joinpath(*parts).resolve()
            is_ours = found.is_relative_to(self.folder) and found.is_file()
        except (OSError, ValueError):  # too long, a loop of links, a zero byte
            return None
        return found if is_ours and found.suffix in MIME_TYPES else None

    def start(self, address: str) -> str | None:
        """The address to which a visitor of `/` is redirected; None = the folder's page is there."""
        if self.data_port is not None:
            return WebViewer(address, live=live_url(self.data_port)).of_live()
        return WebViewer(address).of_file(self.only) if self.only is not None else None


@contextlib.contextmanager
def _serve(site: _Site, port: int) -> Iterator[str]:
    """Yields the address of a server for the site; the server ends with the block."""
    for name in VIEWER_FILES:
        viewer_file(name)  # the first visitor does not wait, and errors come before the address
    try:
        server = _Server((LOOPBACK, port), functools.partial(_Handler, site))
    except OSError as error:
        raise RecordingError(
            f"port {port}: cannot be used ({error.strerror}); expected a free one. Take another, or 0."
        ) from None
    thread = threading.Thread(target=server.serve_forever, daemon=True, name="web-viewer")
    thread.start()
    try:
        yield f"http://{LOOPBACK}:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(socketserver.ThreadingTCPServer):
    """One thread per connection; none of them keeps the program alive."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """Stays silent: a browser may close a page in the middle of a file."""


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers GET and HEAD for the site's files and the viewer's."""

    protocol_version = "HTTP/1.1"
    timeout = 60
    server: _Server

    def __init__(self, site: _Site, *args: object) -> None:
        """Handles one connection of the site."""
        self._site = site
        super().__init__(*args)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Sends the file at the path."""
        self._answer()

    def do_HEAD(self) -> None:
        """Sends the headers of the file at the path."""
        self._answer()

    def log_message(self, format: str, *args: object) -> None:
        """Keeps requests off the terminal."""

    def version_string(self) -> str:
        """Hides the version of Python."""
        return "personal-viz"

    def _answer(self) -> None:
        host = f"{LOOPBACK}:{self.server.server_address[1]}"
        if self.headers.get("Host") != host:  # a foreign name that resolves to us must not read recordings
            return self._send_error(403)
        path = urlsplit(self.path).path
        start = self._site.start(f"http://{host}") if path == "/" else None
        if start is not None:
            return self._redirect(start)
        if path.startswith(VIEWER):
            name = path.removeprefix(VIEWER) or VIEWER_FILES[0]
            return self._send_viewer(name) if name in VIEWER_FILES else self._send_error(404)
        found = self._site.file(f"/{self._site.first}" if path == "/" else path)
        if found is not None and found.suffix == ".rrd" and self.headers.get("Sec-Fetch-Dest") == "document":
            return self._redirect(WebViewer(f"http://{host}").of_file(unquote(path).lstrip("/")))
        return self._send_file(found) if found is not None else self._send_error(404)

    def _send_viewer(self, name: str) -> None:
        content = viewer_file(name)
        self._send_head(200, MIME_TYPES[Path(name).suffix], len(content), viewer_policy(self._site.data_port))
        if self.command == "GET":
            self.wfile.write(content)

    def _send_file(self, path: Path) -> None:
        with path.open("rb") as file:
            self._send_head(200, MIME_TYPES[path.suffix], path.stat().st_size, PAGE_POLICY)
            if self.command == "GET":
                shutil.copyfileobj(file, self.wfile)

    def _send_error(self, status: int) -> None:
        self._send_head(status, "text/plain; charset=utf-8", 0, PAGE_POLICY)

    def _redirect(self, location: str) -> None:
        self._send_head(302, "text/plain; charset=utf-8", 0, PAGE_POLICY, Location=location)

    def _send_head(self, status: int, mime_type: str, length: int, policy: str, **more: str) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": mime_type,
            "Content-Length": str(length),
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "X-DNS-Prefetch-Control": "off",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",  # recordings may hold licensed pictures
        }
        for name, value in (headers | more).items():
            self.send_header(name, value)
        self.end_headers()


def viewer_policy(data_port: int | None = None) -> str:
    """The content security policy of the viewer's page: it allows our server and one live stream, nothing else."""
    scripts = _INLINE_SCRIPT.findall(viewer_file("index.html"))
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'" for script in scripts)
    stream = f" http://{LOOPBACK}:{data_port}" if data_port is not None else ""
    return (
        f"default-src 'none'; script-src 'self' 'wasm-unsafe-eval' {hashes}; style-src 'unsafe-inline'; "
        f"img-src 'self' data: blob:; font-src data:; connect-src 'self'{stream}; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    )


@functools.cache
def _taken_files() -> dict[str, bytes]:
    """The viewer's files from Rerun's program, without links to other machines and without debug lines."""
    taken: dict[str, bytes] = {}
    with running_rerun("--serve-web", "--web-viewer-port", "0", announces=WEB_PORT) as rerun:
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        for name in VIEWER_FILES:
            try:
                with opener.open(f"http://{LOOPBACK}:{rerun.port}/{name}", timeout=60) as reply:
                    taken[name] = reply.read()
            except (OSError, urllib.error.HTTPError) as error:
                raise RecordingError(
                    f"rerun {version('rerun-sdk')}: its web viewer has no {name} ({error}); expected rerun 0.41's "
                    "files. Install the version of constraints.txt."
                ) from None
    taken["index.html"] = _OUTSIDE_LINK.sub(b"", taken["index.html"]).replace(b"<head>", b"<head>" + _QUIET, 1)
    return taken
