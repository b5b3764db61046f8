"""Serves Rerun's web viewer on loopback, under a policy that lets it contact nothing else.

Rerun's own page sends usage data even if its settings forbid it, and its server keeps a core busy while it shows a
file. Here the page's files are taken once from Rerun's program, and plain HTTP serves them beside the recordings.
"""

import base64
import contextlib
import functools
import hashlib
import re
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.routing import Route

from sim.cache import cached_bytes
from sim.errors import RecordingError
from sim.files import write_whole

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
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-DNS-Prefetch-Control": "off",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",  # recordings may hold licensed pictures
}
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


def write_viewer(folder: Path) -> None:
    """Writes the viewer's page for a static host, under a policy that lets it contact that host only.

    `index.html?url=ADDRESS` shows the recording at this whole address. Raises RecordingError like `viewer_file`.
    """
    policy = (
        f'<meta http-equiv="Content-Security-Policy" content="{viewer_policy().partition("; frame-ancestors")[0]}">'
    )
    for name in VIEWER_FILES:
        content = viewer_file(name)
        if name == "index.html":
            content = content.replace(b"<head>", b"<head>" + policy.encode(), 1)
        write_whole(folder / name, content)


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
        """The served file for a URL's decoded path; None = there is no such file, or it must not be read."""
        parts = PurePosixPath(path).parts[1:]
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
        listener = socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise RecordingError(
            f"port {port}: cannot be used ({error.strerror}); expected a free one. Take another, or 0."
        ) from None
    host = f"{LOOPBACK}:{listener.getsockname()[1]}"
    app = Starlette(routes=[Route("/{path:path}", functools.partial(_answer, site, host))])
    settings = {"log_config": None, "lifespan": "off", "ws": "none", "server_header": False}
    server = uvicorn.Server(uvicorn.Config(app, timeout_graceful_shutdown=1, **settings))
    thread = threading.Thread(target=server.run, args=([listener],), daemon=True, name="web-viewer")
    thread.start()
    try:
        yield f"http://{host}"
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


async def _answer(site: _Site, host: str, request: Request) -> Response:
    """The site's or the viewer's file at the path, with the headers of all answers."""
    reply = _reply(site, host, request)
    policy = viewer_policy(site.data_port) if request.url.path.startswith(VIEWER) else PAGE_POLICY
    reply.headers.update(_HEADERS | {"Content-Security-Policy": policy})
    return reply


def _reply(site: _Site, host: str, request: Request) -> Response:
    if request.headers.get("Host") != host:  # a foreign name that resolves to us must not read recordings
        return Response(status_code=403)
    path, address = request.scope["path"], f"http://{host}"
    start = site.start(address) if path == "/" else None
    if start is not None:
        return RedirectResponse(start, 302)
    if path.startswith(VIEWER):
        name = path.removeprefix(VIEWER) or VIEWER_FILES[0]
        known = name in VIEWER_FILES
        return (
            Response(viewer_file(name), media_type=MIME_TYPES[Path(name).suffix])
            if known
            else Response(status_code=404)
        )
    found = site.file(f"/{site.first}" if path == "/" else path)
    if found is None:
        return Response(status_code=404)
    if found.suffix == ".rrd" and request.headers.get("Sec-Fetch-Dest") == "document":
        return RedirectResponse(WebViewer(address).of_file(path.lstrip("/")), 302)
    return FileResponse(found, media_type=MIME_TYPES[found.suffix])


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
