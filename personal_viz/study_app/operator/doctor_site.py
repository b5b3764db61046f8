"""The address that `study doctor` checks: plain requests with headers of our choice, and their replies."""

import http.client
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from sim.errors import StudyError

TIMEOUT_S = 15.0
LOOPBACK = ("127.0.0.1", "localhost", "::1")
MAX_REPLY_BYTES = 4 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Reply:
    """The reply to a request."""

    status: int
    headers: Mapping[str, str]
    """Headers by lower-case name; the last one where a name occurs several times."""
    body: bytes
    took_s: float
    at_s: float
    """Time of our wall clock in the middle of the request."""


@dataclass(frozen=True, slots=True)
class Site:
    """The address of a study."""

    scheme: str
    name: str
    port: int
    netloc: str
    """Name and port, as browsers send them in Host."""
    context: ssl.SSLContext | None
    http_port: int | None
    """Port that answers plain HTTP; None = not known."""

    @property
    def origin(self) -> str:
        """Scheme, name and port, as browsers send them in Origin."""
        return f"{self.scheme}://{self.netloc}"

    def connection(self) -> http.client.HTTPConnection:
        """A new connection, which the caller closes."""
        if self.context is not None:
            return http.client.HTTPSConnection(self.name, self.port, timeout=TIMEOUT_S, context=self.context)
        return http.client.HTTPConnection(self.name, self.port, timeout=TIMEOUT_S)

    def ask(self, path: str, *, headers: Mapping[str, str] | None = None, body: bytes | None = None) -> Reply:
        """The reply to a GET, or to a POST if there is a body, over a new connection; `headers` may replace Host."""
        connection = self.connection()
        try:
            return ask(connection, path, headers={"Host": self.netloc, **(headers or {})}, body=body)
        finally:
            connection.close()


def ask(
    connection: http.client.HTTPConnection, path: str, *, headers: Mapping[str, str], body: bytes | None = None
) -> Reply:
    """The reply to one request over an open connection; `headers` include Host."""
    began_s, at_s = time.monotonic(), time.time()
    kind = {} if body is None else {"Content-Type": "application/json"}
    connection.request("GET" if body is None else "POST", path, body, {**kind, **headers})
    with connection.getresponse() as response:
        content = response.read(MAX_REPLY_BYTES)
        found = {name.lower(): value for name, value in response.getheaders()}
    took_s = time.monotonic() - began_s
    return Reply(response.status, found, content, took_s, at_s + took_s / 2)


def site_from_url(url: str, *, insecure_ca: Path | None, http_port: int | None) -> Site:
    """The site at an address.

    Raises:
        StudyError: The address is not valid, or the file of certificates cannot be used.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.username is not None:
        raise StudyError(
            f"--url {url}: is not the address of a study; expected one such as https://study.example.org. Correct it."
        )
    context = None
    if parts.scheme == "https":
        context = ssl.create_default_context()
        try:
            if insecure_ca is not None:
                context.load_verify_locations(insecure_ca)
        except (OSError, ssl.SSLError) as error:
            raise StudyError(
                f"--insecure-ca {insecure_ca}: cannot be used ({error}); expected certificates as PEM. "
                "Give the certificate of the laboratory's proxy or of its authority."
            ) from None
    return Site(
        scheme=parts.scheme,
        name=parts.hostname,
        port=port or (443 if parts.scheme == "https" else 80),
        netloc=parts.netloc,
        context=context,
        http_port=http_port or (80 if port in (None, 443) and parts.scheme == "https" else None),
    )
