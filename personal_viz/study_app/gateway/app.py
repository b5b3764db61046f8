"""Our web server in front of viser: personal links, sessions, checks, and a filtered proxy of viser's websocket.

viser itself has no login and listens on loopback only; everything that a browser sends passes through here.
"""

import contextlib
import itertools
import random
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TypeVar
from urllib.parse import parse_qsl

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from sim.errors import StudyError
from sim.page_style import TOKENS

from ..page_script import STATIC, is_other_viser, page_of, page_version
from .admission import Admission, Arrival, DeviceProfile, Tickets
from .http import Guard, OwnOrigin, address_of, small_body, too_many_tries
from .limits import DOWNLOADS, GUESSES, JOINS, AddressLimit, Holds, forwarded_address
from .options import ServeOptions
from .pages import MAX_FORM_BYTES, Pages
from .proxy import BAD, LATER, join
from .workers import WorkerPool

SESSION_COOKIE = "personal_session"
PROBE_COOKIE = "personal_probe"
"""Cookie of `/check/download` with the flags of the session's cookie; `study doctor` checks that they arrive."""
PROBE_BYTES = 256 * 1024
PROXY_HEADER = "X-Study-Proxy"
"""Header of `/check/download`: `none` = no proxy is set, `named` = the proxy names its client, `silent` = not."""
MAX_JSON_BYTES = 4096
OTHER_VERSION, OTHER_VERSION_STATUS = "the study's program was updated; load the page again", 409
"""Answer to a websocket of a page that an earlier or later version of the program served."""
MOST_PER_TICKET = 6
"""Most connections of one session: tabs, and broken lines that are not noticed yet."""
Body = TypeVar("Body", bound=msgspec.Struct)
_VISER_CSP = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src data:; worker-src blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'"
)

_PAGE_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'self'",
    "Referrer-Policy": "same-origin",  # with "no-referrer" browsers send no Origin with a form, and we need it
}


class Entry(msgspec.Struct, frozen=True):
    """The message by which a page enters."""

    token: str = ""
    device: DeviceProfile | None = None


class Gateway:
    """The handlers of all routes."""

    def __init__(
        self,
        admission: Admission,
        seats: WorkerPool,
        *,
        tickets: Tickets,
        options: ServeOptions,
        pages: Pages,
        present: Callable[[str], AbstractContextManager[None]] | None = None,
        screen_out_code: str | None = None,
        tell: Callable[[str], None] | None = None,
        note_error: Callable[[str, str], None] | None = None,
    ) -> None:
        """Takes the parts that the routes need.

        Args:
            admission: Decides who may take part.
            seats: The viser workers.
            tickets: Filled here; the workers look up the participant of each connection.
            options: Host names, limits, TLS.
            pages: The pages that participants read and answer outside viser.
            present: Context manager that is entered for each participant's connection while it is open.
            screen_out_code: Shown to people for whom there is no place.
            tell: Writes one line for the person at the terminal; None = to standard error.
            note_error: Stores an error of a participant's connection with the trial; called from any thread.
        """
        self._version = options.page_version or page_version()
        self._page = page_of(self._version, pages.words)
        self._note_error = note_error
        self._admission, self._seats, self._tickets, self._options = admission, seats, tickets, options
        self._pages, self._enter = pages, pages.message("enter")
        self._present = present or (lambda _: contextlib.nullcontext())
        self._screen_out_code = screen_out_code
        self._tell = tell or (lambda line: print(f"personal-viz: {line}", file=sys.stderr))
        self._guesses, self._joins, self._downloads = (AddressLimit(*rate) for rate in (GUESSES, JOINS, DOWNLOADS))
        self._people, self._sessions = Holds(), Holds()
        self._numbers = itertools.count(1)
        """Numbers for connections, in the order in which they come."""
        self._probe = random.Random(0).randbytes(PROBE_BYTES)  # cannot be compressed on the way

    def app(self) -> Starlette:
        """The ASGI application."""
        ours = [Middleware(OwnOrigin, options=self._options)]
        routes = [
            Route("/", self.enter_page),
            Route("/enter", self.enter, methods=["POST"], middleware=ours),
            Route("/page/{ticket:str}/", self.page, methods=["GET", "POST"], middleware=ours),
            Route("/page/{ticket:str}/leave", self.leave_page),
            WebSocketRoute("/page/{ticket:str}/here", self.here, middleware=ours),
            Route("/view/", self.view),
            Route("/check/download", self.download),
            Route("/page-version", self.version),
            WebSocketRoute("/ws/{ticket:str}", self.websocket, middleware=ours),
            WebSocketRoute("/ws/{ticket:str}/{version:str}", self.websocket, middleware=ours),
            Route("/static/tokens.css", self.tokens),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        if self._admission.has_open_link:
            routes += [Route("/join", self.enter_page), Route("/join", self.join, methods=["POST"], middleware=ours)]
        guard = Middleware(Guard, options=self._options)
        return Starlette(routes=routes, middleware=[guard], exception_handlers={StudyError: self._paused})

    async def enter_page(self, _: Request) -> Response:
        """The page that trades the token in its address, or the parameters of a recruiting platform, for a session."""
        return self._enter_page()

    async def enter(self, request: Request) -> Response:
        """A session for a known token: the address of its pages, and a cookie for them and their websocket only."""
        entry = await _json(request, Entry) or Entry()
        code = await run_in_threadpool(self._admission.code_of_token, entry.token) if entry.token else None
        if code is None:  # only now, so that wrong guesses behind the same router do not keep a valid token out
            if not self._guesses.allows(address_of(request, self._options), time.monotonic()):
                return too_many_tries()
            return PlainTextResponse("unknown token", status_code=401)
        if self._is_crowded(code):
            return PlainTextResponse("too many people at once", status_code=503, headers={"Retry-After": "60"})
        profile = entry.device.coarse() if entry.device is not None else None
        session_id, ticket_id = await run_in_threadpool(self._tickets.issue, code, profile)
        page = f"/page/{ticket_id}"
        reply = JSONResponse({"view": self._view_address(request, ticket_id), "page": f"{page}/"})
        for path in (f"/ws/{ticket_id}", page):
            self._set_cookie(reply, request, SESSION_COOKIE, session_id, path=path)
        return reply

    async def join(self, request: Request) -> Response:
        """A personal token for somebody on the open link, or the answer that the study is full."""
        if not self._joins.allows(address_of(request, self._options), time.monotonic()):
            return too_many_tries()
        arrival = await _json(request, Arrival)
        if arrival is None or (self._admission.needs_platform_id and arrival.PROLIFIC_PID is None):
            return PlainTextResponse("parameters of the platform are missing or damaged", status_code=400)
        token = await run_in_threadpool(self._admission.join, arrival)
        if token is None:
            return JSONResponse({"full": True, "code": self._screen_out_code})
        return JSONResponse({"token": token})

    async def page(self, request: Request) -> Response:
        """The participant's current page; the answer of a form is stored and leads to the next page."""
        ticket_id, code = request.path_params["ticket"], self._holder(request)
        if code is None:
            return self._enter_page()
        base = f"/page/{ticket_id}/"
        with self._present(code):
            if request.method == "POST":
                await run_in_threadpool(self._pages.answer, code, await _form(request))
                return RedirectResponse(base, status_code=303)
            number = request.query_params.get("page", "1")
            number = int(number) if number.isascii() and number.isdecimal() and len(number) < 4 else 1
            shown = await run_in_threadpool(self._pages.shown, code, base, page=number)
        if shown is None:
            return RedirectResponse(self._view_address(request, ticket_id), status_code=303)
        return HTMLResponse(shown, headers=_PAGE_HEADERS)

    async def leave_page(self, request: Request) -> Response:
        """The page that asks somebody who wants to leave the study to confirm it."""
        code, base = self._holder(request), f"/page/{request.path_params['ticket']}/"
        if code is None:
            return self._enter_page()
        shown = await run_in_threadpool(self._pages.leaving, code, base)
        return RedirectResponse(base, status_code=303) if shown is None else HTMLResponse(shown, headers=_PAGE_HEADERS)

    async def here(self, socket: WebSocket) -> None:
        """A websocket that is open while a page is open: its participant is here and keeps the place in the study."""
        code = self._holder(socket)
        if code is None:
            await socket.close(code=BAD)
            return
        with self._sessions.one(socket.path_params["ticket"], MOST_PER_TICKET) as is_allowed:
            if not is_allowed:
                await socket.close(code=LATER)
                return
            await socket.accept()
            with self._people.one(code, None), self._present(code), contextlib.suppress(WebSocketDisconnect, KeyError):
                await socket.receive_text()  # a page never sends anything
            with contextlib.suppress(RuntimeError):  # the browser left by itself
                await socket.close(code=BAD)

    def _holder(self, connection: HTTPConnection) -> str | None:
        """The participant of the ticket in the address, if the browser has the cookie that belongs to it; else None."""
        ticket = self._tickets.find(connection.path_params["ticket"])
        if ticket is None or not ticket.admits(connection.cookies.get(SESSION_COOKIE, "")):
            return None
        return ticket.code

    async def view(self, request: Request) -> Response:
        """viser's client; the entry page instead when the ticket in the address is no longer valid.

        A page from before an upgrade that is loaded again gets the address of the current version.
        """
        asked = request.query_params.get("websocket", "").partition("/ws/")[2]
        ticket_id = asked.partition("/")[0]
        if self._tickets.find(ticket_id) is None:
            return self._enter_page()
        if asked != f"{ticket_id}/{self._version}":
            return RedirectResponse(self._view_address(request, ticket_id))
        return Response(self._page, media_type="text/html", headers={"Content-Security-Policy": _VISER_CSP})

    async def version(self, _: Request) -> Response:
        """The version of the served pages, for open pages that check whether they are up to date."""
        return PlainTextResponse(self._version)

    async def tokens(self, _: Request) -> Response:
        """The tokens of the design system, which the style sheets of all pages name."""
        return FileResponse(TOKENS)

    async def download(self, request: Request) -> Response:
        """Bytes by which `study doctor` measures the line."""
        if not self._downloads.allows(address_of(request, self._options), time.monotonic()):
            return too_many_tries()
        peer = request.client.host if request.client is not None else None
        named = forwarded_address(peer, request.headers.getlist("x-forwarded-for"), self._options.proxy)
        state = "none" if self._options.proxy is None else "silent" if named is None else "named"
        reply = Response(self._probe, media_type="application/octet-stream", headers={PROXY_HEADER: state})
        self._set_cookie(reply, request, PROBE_COOKIE, "1", path="/check/")
        return reply

    async def websocket(self, socket: WebSocket) -> None:
        """Joins a participant's websocket to a viser worker."""
        number = next(self._numbers)
        ticket_id, code = socket.path_params["ticket"], self._holder(socket)
        if code is None:
            await socket.close(code=BAD)
            return
        if socket.path_params.get("version") != self._version or is_other_viser(socket.scope["subprotocols"]):
            await socket.send_denial_response(PlainTextResponse(OTHER_VERSION, status_code=OTHER_VERSION_STATUS))
            return
        if self._is_crowded(code):
            await socket.close(code=LATER)
            return
        with (
            self._people.one(code, None),
            self._sessions.one(ticket_id, MOST_PER_TICKET) as is_allowed,
            self._seats.seat(code) as door,
        ):
            if door is None or not is_allowed:
                await socket.close(code=LATER)
                return
            with self._present(code):
                reason = await join(socket, door, ticket_id, number)
        if reason is not None:
            self._tell(f"a connection of {code} was closed: it sent {reason}")
            if self._note_error is not None:
                with contextlib.suppress(StudyError):  # a store that cannot write has reported it itself
                    await run_in_threadpool(self._note_error, code, f"connection closed: sent {reason}")

    async def _paused(self, request: Request, error: Exception) -> Response:
        """The answer while the store cannot write; nothing is lost."""
        self._tell(str(error))
        later = {"Retry-After": "60"}
        if not request.url.path.startswith("/page/"):
            return PlainTextResponse("the study is paused", status_code=503, headers=later)
        return HTMLResponse(self._pages.message("paused"), status_code=503, headers=_PAGE_HEADERS | later)

    def _enter_page(self) -> Response:
        return HTMLResponse(self._enter)

    def _view_address(self, request: Request, ticket_id: str) -> str:
        host = request.headers["host"]
        scheme = "wss" if self._options.is_secure(host) else "ws"
        return f"/view/?websocket={scheme}://{host}/ws/{ticket_id}/{self._version}"

    def _is_crowded(self, code: str) -> bool:
        return code not in self._people and len(self._people) >= self._options.max_people

    def _set_cookie(self, reply: Response, request: Request, name: str, value: str, *, path: str) -> None:
        is_secure = self._options.is_secure(request.headers["host"])
        reply.set_cookie(name, value, httponly=True, samesite="strict", secure=is_secure, path=path)


async def _json(request: Request, kind: type[Body]) -> Body | None:
    """A small JSON body as a `kind`; None when it has another form."""
    try:
        return msgspec.json.decode(await small_body(request, MAX_JSON_BYTES), type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None


async def _form(request: Request) -> dict[str, str]:
    """The fields of a small form; {} when the body is not a form."""
    body = await small_body(request, MAX_FORM_BYTES)
    try:
        return dict(parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=20))
    except ValueError:
        return {}
