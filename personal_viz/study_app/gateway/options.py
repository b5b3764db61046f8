"""Options of serving a study: addresses, names, TLS, limits. Unsafe options are refused here, before work starts."""

import ipaddress
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from tyro.conf import Fixed, Suppress, arg

from human_study.design.study import StudyConfig
from human_study.trial.terms import SHOWS_HOME
from sim.errors import StudyError
from sim.homes.kind import HM3D_TERMS
from sim.types import SceneKind

from .heartbeat import Heartbeat

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
MOST_DEFAULT_WORKERS = 4
_HOST = re.compile(r"\A[A-Za-z0-9.:\[\]-]{1,255}\Z")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Choices of the person who serves a study, as `study serve` takes them; none of them changes a result."""

    port: int = 8080
    """Port to listen on; 0 takes a free one."""
    bind: str = "127.0.0.1"
    """Address to listen on; beyond loopback only with --public."""
    public: bool = False
    """Whether people may come from other machines; needs TLS or a proxy that does it."""
    hosts: Annotated[tuple[str, ...], arg(name="host")] = ()
    """Names under which people reach us, as browsers send them: `study.example.org`, with `:port` unless it is 443."""
    tls_cert: Path | None = None
    tls_key: Path | None = None
    proxy: str | None = None
    """Address of the reverse proxy in front of us, which does TLS; only its X-Forwarded-For is trusted."""
    i_have_rights: bool = False
    """Whether the licence of the scans allows sending them to participants."""
    pilot: bool = False
    """Whether to serve without an ethics approval; the records say for ever that they are a pilot's."""
    workers: int | None = None
    """Number of viser processes; None = one per core, at most four."""
    max_people: int = 200
    """Most participants connected at once."""
    dashboard_port: int = 0
    """Port of the researcher's page, always on loopback; 0 takes a free one."""
    per_address: int = 64
    """Most connections from one address at once; loopback and the named proxy are not limited."""
    heartbeat: Annotated[Heartbeat, Fixed, Suppress] = field(default_factory=Heartbeat)
    """Decides when a viser process counts as hung; it is then killed and started again."""
    drain_s: Annotated[float, Fixed, Suppress] = 10.0
    """Seconds that connections and viser processes together get to end when the study stops."""
    page_version: Annotated[str | None, Fixed, Suppress] = None
    """Version of the pages that we serve and accept, letters and digits; None = this program's (`page_version`)."""

    @property
    def num_workers(self) -> int:
        """Number of viser processes to start."""
        return max(1, min(os.cpu_count() or 1, MOST_DEFAULT_WORKERS)) if self.workers is None else self.workers

    @property
    def has_tls(self) -> bool:
        """Whether this program does TLS itself."""
        return self.tls_cert is not None

    @property
    def host_names(self) -> frozenset[str]:
        """Every accepted name of the Host header, without port: our public names and loopback."""
        bound = () if _is_wildcard(self.bind) else (self.bind,)
        return LOOPBACK_NAMES | {_name(host) for host in (*self.hosts, *bound)}

    def is_secure(self, host: str) -> bool:
        """Whether browsers reach us by https under this Host header: always with our own TLS, else by the proxy."""
        is_public = host.lower() in self.hosts or _name(host) not in LOOPBACK_NAMES
        return self.has_tls or (self.proxy is not None and is_public)

    def is_own_origin(self, host: str, origin: str) -> bool:
        """Whether a page of this Origin header is ours, by scheme, name and port; `host` is the Host header."""
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        scheme = "https" if self.is_secure(host) else "http"
        return (parts.scheme, parts.netloc.lower()) == (scheme, host.lower())

    def address(self, port: int) -> str:
        """The beginning of personal links, for the port that we listen on."""
        scheme = "https" if self.has_tls or self.proxy else "http"
        if self.hosts and (self.proxy or urlsplit(f"//{self.hosts[0]}").port is not None):
            return f"{scheme}://{self.hosts[0]}"
        host = self.hosts[0] if self.hosts else ("127.0.0.1" if _is_wildcard(self.bind) else self.bind)
        host = f"[{host}]" if host.count(":") > 1 and not host.startswith("[") else host
        return f"{scheme}://{host}" + ("" if (scheme, port) in {("https", 443), ("http", 80)} else f":{port}")


def host_name(host: str) -> str:
    """The name in a Host header, lower case, without port; empty when the header holds no name."""
    if _HOST.match(host) is None:
        return ""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def require_may_serve(options: ServeOptions, config: StudyConfig, kinds: Iterable[SceneKind]) -> None:
    """Refuses options that would be unsafe or not allowed.

    Args:
        options: The options of serving.
        config: The study.
        kinds: Kinds of the homes that the study uses.

    Raises:
        StudyError: An option is wrong; the message names the first one and the flag or file that corrects it.
    """
    _require_addresses(options)
    conditions = {condition for task in config.task for condition in config.conditions(task)}
    sends_geometry = bool(conditions & set(SHOWS_HOME)) and config.view_of("scan", public=True) == "browser"
    if options.public and "scan" in kinds and sends_geometry and not options.i_have_rights:
        raise StudyError(
            "--public: with pog_view: browser this study sends the geometry of scans to browsers; expected the right "
            f"to do that. Read the terms of the scans' licence ({HM3D_TERMS} for HM3D), then add --i-have-rights, or "
            "take pog_view: auto, whose pictures are made on the server, or serve on 127.0.0.1 in the laboratory."
        )
    if not config.ethics.irb.strip() and not options.pilot:
        raise StudyError(
            f"study {config.study}: ethics.irb is empty; expected the id of the approval or of the exemption. "
            "Fill it in study.yaml, or add --pilot to try the study out: its data is then marked as a pilot's."
        )
    if not 1 <= options.num_workers <= 64:
        raise StudyError(f"--workers {options.workers}: expected 1 to 64. Leave it out for one per core.")
    for flag, number in (("--max-people", options.max_people), ("--per-address", options.per_address)):
        if number < 1:
            raise StudyError(f"{flag} {number}: expected at least 1. Leave it out for the usual number.")


def _require_addresses(options: ServeOptions) -> None:
    _require_port("--port", options.port)
    _require_port("--dashboard-port", options.dashboard_port)
    is_loopback = _is_loopback(options.bind)
    if not options.public:
        asked = [f"--bind {options.bind}"] * (not is_loopback) + [f"--host {name}" for name in options.hosts]
        asked += ["--proxy"] * (options.proxy is not None)
        if asked:
            raise StudyError(
                f"{asked[0]}: opens the study to other machines; expected --public beside it. "
                "Read docs/deploy.md, then add --public."
            )
    if (options.tls_cert is None) != (options.tls_key is None):
        raise StudyError("--tls-cert and --tls-key: found one of them; expected both. Give the other too.")
    for path in (options.tls_cert, options.tls_key):
        if path is not None and not path.is_file():
            raise StudyError(f"{path}: found no such file; expected PEM for TLS. Correct --tls-cert or --tls-key.")
    if options.proxy is not None and _ip(options.proxy) is None:
        raise StudyError(
            f"--proxy {options.proxy}: is not an address; expected the one that the reverse proxy connects from. "
            "On the same machine that is --proxy 127.0.0.1."
        )
    if options.public and not options.has_tls and options.proxy is None:
        raise StudyError(
            "--public: without TLS anybody on the way reads tokens; expected --tls-cert and --tls-key, or --proxy "
            "ADDRESS of a reverse proxy that does TLS. Add one of them; docs/deploy.md says how."
        )
    if options.public and not options.hosts and (_is_wildcard(options.bind) or is_loopback):
        raise StudyError(
            "--public: found no name for browsers to call; expected --host, for example --host study.example.org."
        )
    for host in options.hosts:
        if _name(host) == "":
            raise StudyError(f"--host {host}: is not a host name; expected one such as study.example.org.")


def _require_port(flag: str, port: int) -> None:
    if not 0 <= port <= 65535:
        raise StudyError(f"{flag} {port}: is not a port; expected 0 to 65535. Take another, for example 8080.")


def _name(host: str) -> str:
    """The host name in an option, which may be a bare IPv6 address; otherwise as `host_name`."""
    return host.lower() if host.count(":") > 1 and not host.startswith("[") else host_name(host)


def _ip(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(address)
    except ValueError:
        return None


def _is_loopback(bind: str) -> bool:
    if bind == "localhost":
        return True
    address = _ip(bind)
    if address is None:
        raise StudyError(f"--bind {bind}: is not an address; expected one such as 127.0.0.1 or 0.0.0.0.")
    return address.is_loopback


def _is_wildcard(bind: str) -> bool:
    address = _ip(bind)
    return address is not None and address.is_unspecified
