"""What `study doctor` looks at, one function per line of its report. A lost connection is the caller's to report."""

import dataclasses
import email.utils
import http.client
import re
import socket
import ssl
import statistics
import time

from .doctor_site import LOOPBACK, TIMEOUT_S, Check, Site, ask

MIN_DAYS = 14
"""Of validity that a certificate has left: a study should not end in the middle of a week."""
MAX_CLOCK_S = 5.0
MAX_ROUND_TRIP_S = 0.25
MIN_MBIT_S = 2.0
"""A participant's pictures need 2 Mbit/s at four keys a second."""
NUM_ROUND_TRIPS = 5
EXPECTED_HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "content-security-policy": "frame-ancestors 'none'",
}
"""What each of our pages carries: name and what the value must contain."""
OWN_PAGE = b"/static/enter.js"
_PROXY_ADVICE = "docs/deploy.md shows the settings of nginx and Caddy."


def check_certificate(site: Site) -> Check:
    """TLS with a certificate that browsers accept, for some time to come."""
    if site.context is None:
        if site.name in LOOPBACK:
            return Check("certificate", None, "not checked: loopback without TLS")
        advice = "Put a reverse proxy with TLS in front, or give --tls-cert and --tls-key. " + _PROXY_ADVICE
        return Check("certificate", False, "plain HTTP: anybody on the way reads the tokens", advice)
    with (
        socket.create_connection((site.name, site.port), timeout=TIMEOUT_S) as raw,
        site.context.wrap_socket(raw, server_hostname=site.name) as secured,
    ):
        certificate, version = secured.getpeercert() or {}, secured.version()
    until = str(certificate.get("notAfter", ""))
    days = (ssl.cert_time_to_seconds(until) - time.time()) / 86400
    detail = f"{version}, valid for {days:.0f} days"
    return Check("certificate", days > MIN_DAYS, detail, f"Renew it: fewer than {MIN_DAYS} days are left.")


def check_page(site: Site) -> Check:
    """Our entry page answers."""
    reply = site.ask("/")
    advice = "See that study serve is running with --host " + site.netloc + " and that the proxy passes Host on: "
    advice += "proxy_set_header Host $http_host (nginx). " + _PROXY_ADVICE
    is_ours = reply.status == 200 and OWN_PAGE in reply.body
    return Check("page", is_ours, f"status {reply.status}" + ("" if is_ours else ", not the study's page"), advice)


def check_redirect(site: Site) -> Check:
    """Plain HTTP leads to HTTPS, or is not answered at all."""
    if site.http_port is None:
        return Check("redirect", None, "not checked: no plain HTTP at an address with a port of its own (--http-port)")
    connection = http.client.HTTPConnection(site.name, site.http_port, timeout=TIMEOUT_S)
    try:
        reply = ask(connection, "/", headers={"Host": site.name})
    except (ConnectionRefusedError, TimeoutError):
        return Check("redirect", True, f"port {site.http_port} does not answer, so nothing is sent in clear")
    finally:
        connection.close()
    where = reply.headers.get("location", "")
    is_redirect = reply.status in (301, 302, 307, 308) and where.startswith("https://")
    advice = "Let the proxy answer plain HTTP with a redirect: return 308 https://$host$request_uri (nginx)."
    return Check("redirect", is_redirect, f"status {reply.status}" + (f" to {where}" if where else ""), advice)


def check_headers(site: Site) -> Check:
    """Pages carry the secure headers, as they left the gateway."""
    found = site.ask("/").headers
    expected = dict(EXPECTED_HEADERS)
    if site.context is not None:
        expected["strict-transport-security"] = "max-age="
    bad = [name for name, part in expected.items() if part not in found.get(name, "")]
    detail = "missing or changed: " + ", ".join(bad) if bad else f"all {len(expected)} are there"
    return Check("security headers", not bad, detail, "Let the proxy pass headers on unchanged. " + _PROXY_ADVICE)


def check_host(site: Site) -> Check:
    """Another name at the same address does not lead to the study."""
    reply = site.ask("/", headers={"Host": "doctor.invalid"})
    is_refused = OWN_PAGE not in reply.body
    advice = "Let the proxy pass the browser's Host on and not set one: proxy_set_header Host $http_host (nginx)."
    return Check("foreign Host", is_refused, f"status {reply.status}" + ("" if is_refused else ": served"), advice)


def check_origin(site: Site) -> Check:
    """Other sites cannot enter for a visitor, and our own page can."""
    guess = b'{"token":"study-doctor"}'
    foreign = site.ask("/enter", headers={"Origin": "https://doctor.invalid"}, body=guess).status
    own = site.ask("/enter", headers={"Origin": site.origin}, body=guess).status
    detail = f"a foreign one: status {foreign}; our own: {own}"
    if foreign != 403:
        return Check("Origin", False, detail, "The foreign one must be refused (403): is this study serve at all?")
    if own == 403:
        advice = f"Our own page is refused: pass Host on with its port, and serve with --host {site.netloc} and TLS or "
        return Check("Origin", False, detail, advice + "--proxy. " + _PROXY_ADVICE)
    return Check("Origin", own in (401, 429), detail, "An unknown token must give 401: is this study serve at all?")


def check_websocket(site: Site) -> Check:
    """The proxy passes the upgrade on, and the gateway refuses one without a ticket."""
    upgrade = {
        "Origin": site.origin,
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "c3R1ZHktZG9jdG9yLTAxIQ==",
    }
    reply = site.ask("/ws/study-doctor", headers=upgrade)
    if reply.status == 403:
        return Check("websocket", True, "reaches the gateway, which refuses it without a ticket (403)")
    advice = (
        "Pass the upgrade on: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; and Connection upgrade "
    )
    advice += "(nginx). " + _PROXY_ADVICE
    return Check("websocket", False, f"status {reply.status}; expected 403 from the gateway", advice)


def check_cookie(site: Site) -> Check:
    """The session's cookie keeps its flags on the way."""
    cookie = site.ask("/check/download").headers.get("set-cookie", "")
    flags = ["HttpOnly", "SameSite=strict"] + ["Secure"] * (site.context is not None)
    bad = [flag for flag in flags if not re.search(rf";\s*{flag}\s*(;|$)", cookie, re.IGNORECASE)]
    detail = "without " + ", ".join(bad) if bad else "has " + ", ".join(flags)
    advice = "Serve with --proxy or --tls-cert, so that the gateway knows of TLS; let the proxy leave cookies alone."
    return Check("cookie", not bad, detail, advice)


def check_forwarding(site: Site) -> Check:
    """The gateway knows for whom the proxy asks, so that limits hold for each address alone."""
    state = site.ask("/check/download").headers.get("x-study-proxy")
    details = {
        "none": "no proxy is named; limits hold for the address that connects",
        "named": "is named and says for whom it asks",
        "silent": "is named but does not say for whom it asks, or somebody else asked",
    }
    advice = "Pass the address on: proxy_set_header X-Forwarded-For $remote_addr (nginx), and name with --proxy the "
    advice += "address from which the proxy connects. " + _PROXY_ADVICE
    return Check("proxy", state in ("none", "named"), details.get(state or "", f"answered {state!r}"), advice)


def check_clock(site: Site) -> Check:
    """The server's clock agrees with ours; times in the records come from it."""
    reply = site.ask("/")
    date = email.utils.parsedate_to_datetime(reply.headers.get("date", ""))
    apart_s = abs(date.timestamp() + 0.5 - reply.at_s)  # the header has whole seconds
    advice = "Set both clocks by NTP: timedatectl set-ntp true."
    return Check("clock", apart_s <= MAX_CLOCK_S, f"{apart_s:.1f} s apart", advice)


def check_round_trip(site: Site) -> Check:
    """A key press is answered soon."""
    connection = site.connection()
    try:
        headers = {"Host": site.netloc}
        ask(connection, "/static/enter.css", headers=headers)  # opens the connection
        times_s = [ask(connection, "/static/enter.css", headers=headers).took_s for _ in range(NUM_ROUND_TRIPS)]
    finally:
        connection.close()
    median_s = statistics.median(times_s)
    advice = "Serve from a machine nearer to the participants; each step takes one round trip."
    return Check("round trip", median_s <= MAX_ROUND_TRIP_S, f"{median_s * 1000:.0f} ms", advice)


def check_line(site: Site) -> Check:
    """Pictures and homes arrive in time."""
    reply = site.ask("/check/download")
    mbit_s = len(reply.body) * 8 / 1e6 / reply.took_s
    check = Check(
        "bandwidth",
        reply.status == 200 and mbit_s >= MIN_MBIT_S,
        f"{mbit_s:.1f} Mbit/s over {len(reply.body)} bytes",
        f"Each participant needs {MIN_MBIT_S:.0f} Mbit/s; find out which line is slow, here or at the server.",
    )
    if reply.status == 429:
        return dataclasses.replace(check, detail="refused: measured too often", advice="Wait a minute.")
    return check
