"""`study doctor`: checks a study's public address from outside, as a browser would, and says what to correct.

It needs only the address; with a personal link it also takes part for a moment.
"""

import asyncio
import email.utils
import functools
import http.client
import http.cookies
import importlib.metadata
import json
import re
import socket
import ssl
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from sim.errors import StudyError

from ..gateway.filter import CAMERA
from .doctor_site import LOOPBACK, TIMEOUT_S, Site, ask, site_from_url

MIN_DAYS = 14
"""Days for which a certificate must still be valid, so that it does not expire in the middle of a study."""
MAX_CLOCK_S = 5.0
MAX_ROUND_TRIP_S = 0.25
MIN_MBIT_S = 2.0
"""Least speed of the line: a participant's pictures need 2 Mbit/s at four keys a second."""
NUM_ROUND_TRIPS = 5
FIRST_MESSAGE_S = 30.0
EXPECTED_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "content-security-policy": "frame-ancestors 'none'",
}
"""Headers of each of our pages: name, and a text that the value must contain."""
OWN_PAGE = b"/static/enter.js"
_PROXY_ADVICE = "docs/deploy.md shows the settings of nginx and Caddy."


class Finding(NamedTuple):
    """The result of a check."""

    passed: bool | None
    """Whether the check passed; None = not checked."""
    detail: str
    """The finding, in words."""
    advice: str = ""
    """Advice on a failure."""


def examine(
    url: str, *, link: str | None = None, insecure_ca: Path | None = None, http_port: int | None = None
) -> dict[str, Finding]:
    """The results of all checks by name, in order.

    Args:
        url: The address that participants open, without a token: `https://study.example.org`.
        link: A personal link at that address, best that of a spare participant, because an open page is superseded.
        insecure_ca: A PEM file of certificates to trust besides the system's, for a laboratory.
        http_port: Port that answers plain HTTP; None = 80 when the address has no port of its own.

    Raises:
        StudyError: The address, the link or the file is not valid.
    """
    site = site_from_url(url, insecure_ca=insecure_ca, http_port=http_port)
    if link is not None and not link.startswith(f"{site.origin}/#"):
        raise StudyError(
            f"--link: does not begin with {site.origin}/#; expected a personal link of this study. "
            "Copy one that study serve printed."
        )
    checks = dict(CHECKS)
    if link is not None:
        checks["session"] = functools.partial(check_session, token=link.partition("#")[2])
    found: dict[str, Finding] = {}
    is_reachable = True
    for name, check in checks.items():
        found[name] = _checked(site, check) if is_reachable else Finding(None, "not checked: see above")
        is_reachable &= found[name].passed is not False or name not in _UNREACHABLE
    if link is None:
        detail = "not checked: give a personal link with --link to take part for a moment"
        found["session"] = Finding(None, detail)
    return found


def _checked(site: Site, check: Callable[[Site], Finding]) -> Finding:
    """The result of a check; a check that cannot be made has failed."""
    try:
        return check(site)
    except (OSError, http.client.HTTPException, WebSocketException, ValueError) as error:
        found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        advice = "See that the address is right, that the proxy and study serve are running, and that a firewall lets "
        return Finding(False, f"no answer ({found})", advice + "port 443 in.")


def check_certificate(site: Site) -> Finding:
    """Whether the certificate is one that browsers accept, and will for some time."""
    if site.context is None:
        if site.name in LOOPBACK:
            return Finding(None, "not checked: loopback without TLS")
        advice = "Put a reverse proxy with TLS in front, or give --tls-cert and --tls-key. " + _PROXY_ADVICE
        return Finding(False, "plain HTTP: anybody on the way reads the tokens", advice)
    with (
        socket.create_connection((site.name, site.port), timeout=TIMEOUT_S) as raw,
        site.context.wrap_socket(raw, server_hostname=site.name) as secured,
    ):
        certificate, version = secured.getpeercert() or {}, secured.version()
    until = str(certificate.get("notAfter", ""))
    days = (ssl.cert_time_to_seconds(until) - time.time()) / 86400
    detail = f"{version}, valid for {days:.0f} days"
    return Finding(days > MIN_DAYS, detail, f"Renew it: fewer than {MIN_DAYS} days are left.")


def check_page(site: Site) -> Finding:
    """Whether our entry page answers."""
    reply = site.ask("/")
    advice = "See that study serve is running with --host " + site.netloc + " and that the proxy passes Host on: "
    advice += "proxy_set_header Host $http_host (nginx). " + _PROXY_ADVICE
    is_ours = reply.status == 200 and OWN_PAGE in reply.body
    return Finding(is_ours, f"status {reply.status}" + ("" if is_ours else ", not the study's page"), advice)


def check_redirect(site: Site) -> Finding:
    """Whether plain HTTP leads to HTTPS, or is not answered at all."""
    if site.http_port is None:
        return Finding(None, "not checked: no plain HTTP at an address with a port of its own (--http-port)")
    connection = http.client.HTTPConnection(site.name, site.http_port, timeout=TIMEOUT_S)
    try:
        reply = ask(connection, "/", headers={"Host": site.name})
    except (ConnectionRefusedError, TimeoutError):
        return Finding(True, f"port {site.http_port} does not answer, so nothing is sent in clear")
    finally:
        connection.close()
    where = reply.headers.get("location", "")
    is_redirect = reply.status in (301, 302, 307, 308) and where.startswith("https://")
    advice = "Let the proxy answer plain HTTP with a redirect: return 308 https://$host$request_uri (nginx)."
    return Finding(is_redirect, f"status {reply.status}" + (f" to {where}" if where else ""), advice)


def check_headers(site: Site) -> Finding:
    """Whether pages arrive with the secure headers that the gateway sends."""
    found = site.ask("/").headers
    expected = dict(EXPECTED_HEADERS)
    if site.context is not None:
        expected["strict-transport-security"] = "max-age="
    bad = [name for name, part in expected.items() if part not in found.get(name, "")]
    detail = "missing or changed: " + ", ".join(bad) if bad else f"all {len(expected)} are there"
    return Finding(not bad, detail, "Let the proxy pass headers on unchanged. " + _PROXY_ADVICE)


def check_host(site: Site) -> Finding:
    """Whether another name at the same address is refused."""
    reply = site.ask("/", headers={"Host": "doctor.invalid"})
    is_refused = OWN_PAGE not in reply.body
    advice = "Let the proxy pass the browser's Host on and not set one: proxy_set_header Host $http_host (nginx)."
    return Finding(is_refused, f"status {reply.status}" + ("" if is_refused else ": served"), advice)


def check_origin(site: Site) -> Finding:
    """Whether our own page can enter, and other sites cannot enter in a visitor's name."""
    guess = b'{"token":"study-doctor"}'
    foreign = site.ask("/enter", headers={"Origin": "https://doctor.invalid"}, body=guess).status
    own = site.ask("/enter", headers={"Origin": site.origin}, body=guess).status
    detail = f"a foreign one: status {foreign}; our own: {own}"
    if foreign != 403:
        return Finding(False, detail, "The foreign one must be refused (403): is this study serve at all?")
    if own == 403:
        advice = f"Our own page is refused: pass Host on with its port, and serve with --host {site.netloc} and TLS or "
        return Finding(False, detail, advice + "--proxy. " + _PROXY_ADVICE)
    return Finding(own in (401, 429), detail, "An unknown token must give 401: is this study serve at all?")


def check_websocket(site: Site) -> Finding:
    """Whether the proxy passes on the upgrade to a websocket, and the gateway refuses one without a ticket."""
    upgrade = {
        "Origin": site.origin,
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "c3R1ZHktZG9jdG9yLTAxIQ==",
    }
    reply = site.ask("/ws/study-doctor", headers=upgrade)
    if reply.status == 403:
        return Finding(True, "reaches the gateway, which refuses it without a ticket (403)")
    advice = "Pass the upgrade on: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; and Connection "
    advice += "upgrade (nginx). " + _PROXY_ADVICE
    return Finding(False, f"status {reply.status}; expected 403 from the gateway", advice)


def check_cookie(site: Site) -> Finding:
    """Whether the session's cookie keeps its flags on the way."""
    cookie = site.ask("/check/download").headers.get("set-cookie", "")
    flags = ["HttpOnly", "SameSite=strict"] + ["Secure"] * (site.context is not None)
    bad = [flag for flag in flags if not re.search(rf";\s*{flag}\s*(;|$)", cookie, re.IGNORECASE)]
    detail = "without " + ", ".join(bad) if bad else "has " + ", ".join(flags)
    advice = "Serve with --proxy or --tls-cert, so that the gateway knows of TLS; let the proxy leave cookies alone."
    return Finding(not bad, detail, advice)


def check_forwarding(site: Site) -> Finding:
    """Whether the gateway knows for whom the proxy asks, so that limits hold for each address alone."""
    state = site.ask("/check/download").headers.get("x-study-proxy")
    details = {
        "none": "no proxy is named; limits hold for the address that connects",
        "named": "is named and says for whom it asks",
        "silent": "is named but does not say for whom it asks, or somebody else asked",
    }
    advice = "Pass the address on: proxy_set_header X-Forwarded-For $remote_addr (nginx), and name with --proxy the "
    advice += "address from which the proxy connects. " + _PROXY_ADVICE
    return Finding(state in ("none", "named"), details.get(state or "", f"answered {state!r}"), advice)


def check_clock(site: Site) -> Finding:
    """Whether the server's clock, from which the records' times come, agrees with ours."""
    reply = site.ask("/")
    date = email.utils.parsedate_to_datetime(reply.headers.get("date", ""))
    apart_s = abs(date.timestamp() + 0.5 - reply.at_s)  # the header has whole seconds
    advice = "Set both clocks by NTP: timedatectl set-ntp true."
    return Finding(apart_s <= MAX_CLOCK_S, f"{apart_s:.1f} s apart", advice)


def check_round_trip(site: Site) -> Finding:
    """Whether a key press is answered soon enough."""
    connection = site.connection()
    try:
        headers = {"Host": site.netloc}
        ask(connection, "/static/forms.css", headers=headers)  # opens the connection
        times_s = [ask(connection, "/static/forms.css", headers=headers).took_s for _ in range(NUM_ROUND_TRIPS)]
    finally:
        connection.close()
    median_s = statistics.median(times_s)
    advice = "Serve from a machine nearer to the participants; each step takes one round trip."
    return Finding(median_s <= MAX_ROUND_TRIP_S, f"{median_s * 1000:.0f} ms", advice)


def check_line(site: Site) -> Finding:
    """Whether the line is fast enough for pictures and homes."""
    reply = site.ask("/check/download")
    if reply.status == 429:
        return Finding(False, "refused: measured too often", "Wait a minute.")
    mbit_s = len(reply.body) * 8 / 1e6 / reply.took_s
    detail = f"{mbit_s:.1f} Mbit/s over {len(reply.body)} bytes"
    advice = f"Each participant needs {MIN_MBIT_S:.0f} Mbit/s; find out which line is slow, here or at the server."
    return Finding(reply.status == 200 and mbit_s >= MIN_MBIT_S, detail, advice)


def check_session(site: Site, token: str) -> Finding:
    """Whether a participant gets in and receives a page.

    Args:
        site: The study's address.
        token: The token of a personal link; it appears in none of our messages.
    """
    entered = site.ask("/enter", headers={"Origin": site.origin}, body=json.dumps({"token": token}).encode())
    if entered.status != 200:
        advice = "Copy a whole personal link of this study; after ten wrong ones wait a minute."
        return Finding(False, f"entering was refused (status {entered.status})", advice)
    view = json.loads(entered.body)["view"]
    url = view.partition("websocket=")[2]
    expected = f"{'wss' if site.context is not None else 'ws'}://{site.netloc}/"
    if not url.startswith(expected):
        advice = f"Serve with --host {site.netloc} and let the proxy pass Host on with its port."
        return Finding(False, f"the page would call {url.partition('/ws/')[0]}; expected {expected}", advice)
    if b"viser" not in site.ask(view).body.lower():
        return Finding(False, "the view is not viser's page", "Let the proxy pass query strings on unchanged.")
    cookies = http.cookies.SimpleCookie(entered.headers.get("set-cookie", ""))
    pair = "; ".join(f"{name}={morsel.value}" for name, morsel in cookies.items())
    first_s, ping_s = asyncio.run(_first_message_and_ping(site, url, pair))
    return Finding(True, f"the first message came after {first_s:.1f} s; a ping takes {ping_s * 1000:.0f} ms")


async def _first_message_and_ping(site: Site, url: str, cookie: str) -> tuple[float, float]:
    """Seconds until viser's first message, and seconds of a ping.

    It does not use `websockets.sync`, which reads and writes one TLS connection from two threads; OpenSSL forbids that.
    """
    began_s = time.monotonic()
    async with connect(
        url,
        ssl=site.context,
        subprotocols=[Subprotocol(f"viser-v{importlib.metadata.version('viser')}")],
        additional_headers={"Cookie": cookie, "Origin": site.origin},
        open_timeout=TIMEOUT_S,
        close_timeout=1,
        max_size=None,
        proxy=None,
    ) as connection:
        await connection.send(msgspec.msgpack.encode(CAMERA))
        await asyncio.wait_for(connection.recv(), FIRST_MESSAGE_S)
        first_s = time.monotonic() - began_s
        pinged_s = time.monotonic()
        async with asyncio.timeout(TIMEOUT_S):
            await (await connection.ping())
        return first_s, time.monotonic() - pinged_s


CHECKS: Sequence[tuple[str, Callable[[Site], Finding]]] = (
    ("certificate", check_certificate),
    ("page", check_page),
    ("redirect", check_redirect),
    ("security headers", check_headers),
    ("foreign Host", check_host),
    ("Origin", check_origin),
    ("websocket", check_websocket),
    ("cookie", check_cookie),
    ("proxy", check_forwarding),
    ("clock", check_clock),
    ("round trip", check_round_trip),
    ("bandwidth", check_line),
)
"""The lines of the report, in order; with a personal link, `session` follows."""
_UNREACHABLE = ("certificate", "page")
"""When one of these checks fails, the others would only repeat the failure."""
