"""`study doctor`: checks a study's public address from outside, as a browser would, and says what to correct.

It needs only the address; with a personal link it also takes part for a moment.
"""

from collections.abc import Callable, Sequence
from http.client import HTTPException
from pathlib import Path

from websockets.exceptions import WebSocketException

from sim.errors import StudyError

from .doctor_checks import (
    check_certificate,
    check_clock,
    check_cookie,
    check_forwarding,
    check_headers,
    check_host,
    check_line,
    check_origin,
    check_page,
    check_redirect,
    check_round_trip,
    check_session,
    check_websocket,
)
from .doctor_site import Check, Site, site_from_url

CHECKS: Sequence[tuple[str, Callable[[Site], Check]]] = (
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
_UNREACHABLE = ("certificate", "page")
"""When one of these checks fails, the others would only repeat the failure."""


def examine(
    url: str, *, link: str | None = None, insecure_ca: Path | None = None, http_port: int | None = None
) -> list[Check]:
    """All checks in order.

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
    found: list[Check] = []
    is_reachable = True
    for name, check in CHECKS:
        if not is_reachable:
            found.append(Check(name, None, "not checked: see above"))
            continue
        found.append(_checked(name, lambda check=check: check(site)))
        is_reachable = found[-1].passed is not False or name not in _UNREACHABLE
    if link is None:
        found.append(Check("session", None, "not checked: give a personal link with --link to take part for a moment"))
    elif is_reachable:
        token = link.partition("#")[2]
        found.append(_checked("session", lambda: check_session(site, token)))
    return found


def _checked(name: str, check: Callable[[], Check]) -> Check:
    """The result of a check; a check that cannot be made has failed."""
    try:
        return check()
    except (OSError, HTTPException, WebSocketException, ValueError) as error:
        found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        advice = "See that the address is right, that the proxy and study serve are running, and that a firewall lets "
        return Check(name, False, f"no answer ({found})", advice + "port 443 in.")
