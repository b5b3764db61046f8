"""A read-only page for the researcher on its own loopback port: places of people, finished trials, never outcomes.

It has its own server and its own token; the gateway that participants reach knows nothing of it.
"""

import contextlib
import functools
import hmac
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from human_study.store.progress import study_progress
from human_study.store.records import read_study
from sim.errors import StudyError
from sim.page_style import TOKENS

from ..gateway.http import Guard, OwnOrigin, listen, served_in_thread, small_body, too_many_tries, uvicorn_server
from ..gateway.lease_keeper import LeaseKeeper
from ..gateway.limits import GUESSES, AddressLimit
from ..gateway.options import ServeOptions
from ..gateway.workers import Worker, WorkerPool
from .progress_view import Serving, ShownWorker, shown_study

PAGE = Path(__file__).parent / "dashboard_page"
FILES = {
    "/": PAGE / "dashboard.html",
    "/dashboard.js": PAGE / "dashboard.js",
    "/dashboard.css": PAGE / "dashboard.css",
    "/tokens.css": TOKENS,
}
LOOK_EVERY_S = 1.0
MAX_TOKEN_BYTES = 256


class Dashboard:
    """The page of one study."""

    def __init__(
        self, folder: Path, *, serving: Callable[[], Serving] = Serving, look_every_s: float = LOOK_EVERY_S
    ) -> None:
        """Reads nothing yet.

        Args:
            folder: The study's folder.
            serving: Returns the facts that only the serving process knows.
            look_every_s: Shortest time between two reads of the database, for any number of open pages.
        """
        self._folder, self._serving, self._look_every_s = folder, serving, look_every_s
        self.token = secrets.token_urlsafe(16)
        """The secret in the link; a browser that shows it gets the session."""
        self._session = secrets.token_urlsafe(16)
        self._guesses = AddressLimit(*GUESSES)
        self._lock = threading.Lock()
        self._looked: tuple[float, bytes] | None = None

    def app(self, port: int) -> Starlette:
        """The ASGI application, for the port that browsers use."""
        self._cookie = f"personal_dashboard_{port}"  # browsers do not keep the cookies of two ports apart
        routes = [Route(path, functools.partial(_file, file)) for path, file in FILES.items()]
        ours = [Middleware(OwnOrigin, options=ServeOptions())]
        routes += [Route("/enter", self.enter, methods=["POST"], middleware=ours), Route("/progress", self.progress)]
        routes += [Route("/favicon.ico", _no_icon)]
        return Starlette(routes=routes, middleware=[Middleware(Guard, options=ServeOptions())])

    async def enter(self, request: Request) -> Response:
        """Gives a browser the cookie in return for the token."""
        if not hmac.compare_digest(await small_body(request, MAX_TOKEN_BYTES), self.token.encode()):
            if not self._guesses.allows("", time.monotonic()):
                return too_many_tries()
            return PlainTextResponse("unknown token", status_code=401)
        reply = Response(status_code=204)
        reply.set_cookie(self._cookie, self._session, httponly=True, samesite="strict", path="/progress")
        return reply

    async def progress(self, request: Request) -> Response:
        """The study's progress, for browsers that have the cookie."""
        cookie = request.cookies.get(self._cookie, "")
        if not hmac.compare_digest(cookie.encode(), self._session.encode()):
            return PlainTextResponse("unknown session", status_code=401)
        try:
            return Response(await run_in_threadpool(self._look), media_type="application/json")
        except StudyError:
            return PlainTextResponse("the study cannot be read now", status_code=503)

    def _look(self) -> bytes:
        with self._lock:
            now_s = time.monotonic()
            if self._looked is None or now_s - self._looked[0] >= self._look_every_s:
                with read_study(self._folder) as reader:
                    found = study_progress(reader, now_ns=time.time_ns())
                self._looked = now_s, msgspec.json.encode(shown_study(found, self._serving()))
            return self._looked[1]


@contextlib.contextmanager
def dashboard(folder: Path, port: int = 0, *, serving: Callable[[], Serving] = Serving) -> Iterator[str]:
    """The dashboard's link, which holds its token; valid until the end of the block.

    Args:
        folder: The study's folder.
        port: Port on loopback; 0 takes a free one.
        serving: Returns the facts that only the serving process knows.

    Raises:
        StudyError: The port is taken.
    """
    page = Dashboard(folder, serving=serving)
    with listen("127.0.0.1", port, advice="Take another --dashboard-port, or 0 for any.") as listener:
        port = listener.getsockname()[1]
        with served_in_thread(uvicorn_server(page.app(port), ServeOptions()), listener):
            yield f"http://127.0.0.1:{port}/#{page.token}"


def serving_of(pool: WorkerPool, keeper: LeaseKeeper) -> Serving:
    """The facts that only the serving process knows, as of now."""
    return Serving(tuple(_worker(worker) for worker in list(pool.workers)), keeper.people_here())


def _worker(worker: Worker) -> ShownWorker:
    process = worker.process
    is_alive = process is not None and process.poll() is None
    state = "ended" if not is_alive else "serving" if worker.door is not None else "starting"
    return ShownWorker(worker.number, state, len(worker.codes))


async def _file(path: Path, _: Request) -> Response:
    return FileResponse(path)


async def _no_icon(_: Request) -> Response:
    return Response(status_code=204)
