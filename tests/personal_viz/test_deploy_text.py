"""The proxy settings of docs/deploy.md and docs/deploy work: nginx and Caddy read them where they are installed."""

import http.client
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.operator.doctor import examine
from personal_viz.study_app.operator.served import free_port

from .gateways import running, wait_until
from .tls_proxy import self_signed

DEPLOY = Path(__file__).parents[2] / "docs" / "deploy.md"
CADDYFILE = DEPLOY.with_suffix("") / "Caddyfile"
EXCLUDED = "exclude http.log.error http.handlers.reverse_proxy"
NGINX, CADDY = shutil.which("nginx"), shutil.which("caddy")
Proxy = Callable[..., AbstractContextManager[None]]
needs_nginx = pytest.mark.skipif(NGINX is None, reason="found no nginx; install it to check the text of docs/deploy.md")
needs_caddy = pytest.mark.skipif(CADDY is None, reason="found no caddy; install it to check docs/deploy/Caddyfile")


def text_of(language: str) -> str:
    """The document's block in this language, as it is printed."""
    found = re.search(rf"```{language}\n(.*?)```", DEPLOY.read_text(encoding="utf-8"), re.DOTALL)
    return found.group(1)


def replaced(text: str, places: Mapping[str, str], changed: tuple[str, str]) -> str:
    """The text with one setting changed, and this machine's values in place of the document's."""
    assert changed[0] in text
    text = text.replace(*changed) if changed[0] else text
    for found, place in places.items():
        assert found in text
        text = text.replace(found, place)
    return text


def is_answered(port: int) -> bool:
    """Whether somebody listens."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def nginx(folder: Path, ports: dict[str, int], behind: int, *, changed: tuple[str, str] = ("", "")) -> Iterator[None]:
    """The document's nginx in front of a port, with free ports, our certificate, and one setting changed."""
    certificate, key = self_signed(folder)
    places = {
        "listen 80;": f"listen 127.0.0.1:{ports['http']};",
        "listen 443 ssl;": f"listen 127.0.0.1:{ports['tls']} ssl;",
        "server_name study.example.org;": "server_name localhost;",
        "/etc/letsencrypt/live/study.example.org/fullchain.pem": str(certificate),
        "/etc/letsencrypt/live/study.example.org/privkey.pem": str(key),
        "127.0.0.1:8080": f"127.0.0.1:{behind}",
    }
    text = replaced(text_of("nginx"), places, changed)
    temporary = " ".join(f"{kind}_temp_path {folder}/{kind};" for kind in ("client_body", "proxy", "fastcgi"))
    temporary += " ".join(f" {kind}_temp_path {folder}/{kind};" for kind in ("uwsgi", "scgi"))
    main = f"daemon off; pid {folder}/nginx.pid; error_log {folder}/error.log; events {{}}\n"
    (folder / "nginx.conf").write_text(f"{main}http {{ {temporary} access_log off;\n{text}\n}}\n")
    assert NGINX is not None
    process = subprocess.Popen([NGINX, "-p", str(folder), "-e", f"{folder}/error.log", "-c", f"{folder}/nginx.conf"])
    yield from until_ended(process, ports, folder / "error.log")


@contextmanager
def caddy(folder: Path, ports: dict[str, int], behind: int, *, changed: tuple[str, str] = ("", "")) -> Iterator[None]:
    """The Caddyfile, likewise; its own files stay in the folder."""
    certificate, key = self_signed(folder)
    places = {
        "{$STUDY_HOST:study.example.org} {": f"{{$STUDY_HOST:study.example.org}} {{\n    tls {certificate} {key}",
        "127.0.0.1:8080": f"127.0.0.1:{behind}",
    }
    text = replaced(CADDYFILE.read_text(encoding="utf-8"), places, changed)
    own = f"admin off\nhttp_port {ports['http']}\nhttps_port {ports['tls']}\ndefault_bind 127.0.0.1\n"
    (folder / "Caddyfile").write_text(text.replace("{\n", "{\n" + own, 1))
    assert CADDY is not None
    command = [CADDY, "run", "--config", str(folder / "Caddyfile"), "--adapter", "caddyfile"]
    homes = {name: str(folder) for name in ("HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME")} | {"STUDY_HOST": "localhost"}
    with (folder / "caddy.log").open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | homes)
        yield from until_ended(process, ports, folder / "caddy.log")


def until_ended(process: subprocess.Popen[bytes], ports: dict[str, int], log: Path) -> Iterator[None]:
    """A running proxy, once it listens; ended when the test goes on."""
    try:
        wait_until(lambda: all(map(is_answered, ports.values())) or process.poll() is not None)
        assert process.poll() is None, log.read_text()
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=30)


def failures(proxy: Proxy, folder: Path, *, changed: tuple[str, str] = ("", "")) -> list[str]:
    """Names of the doctor's checks that fail for a gateway behind it."""
    ports = {"tls": free_port(), "http": free_port()}
    options = ServeOptions(port=0, public=True, hosts=(f"localhost:{ports['tls']}",), proxy="127.0.0.1", pilot=True)
    with running(folder, options=options) as gateway, proxy(folder, ports, gateway.port, changed=changed):
        url = f"https://localhost:{ports['tls']}"
        checks = examine(url, link=f"{url}/#good", insecure_ca=folder / "cert.pem", http_port=ports["http"])
    assert all(check.passed is not None for check in checks.values())
    return [name for name, check in checks.items() if not check.passed]


CHANGES = {
    nginx: [
        ("$http_host;", "$host;", ["security headers", "Origin", "cookie", "session"]),
        ("proxy_set_header Upgrade $http_upgrade;", "", ["websocket", "session"]),
        ("proxy_set_header X-Forwarded-For $remote_addr;", "", ["proxy"]),
        ("return 308 https://$host$request_uri;", "return 200 hello;", ["redirect"]),
    ],
    caddy: [
        (
            "flush_interval -1",
            "header_up Host {upstream_hostport}",
            ["security headers", "Origin", "cookie", "session"],
        ),
        ("flush_interval -1", "header_up -X-Forwarded-For", ["proxy"]),
        ("flush_interval -1", "header_down -Content-Security-Policy", ["security headers"]),
    ],
}
NEEDS = {nginx: needs_nginx, caddy: needs_caddy}


@pytest.mark.slow
@pytest.mark.parametrize("proxy", [pytest.param(proxy, marks=mark, id=proxy.__name__) for proxy, mark in NEEDS.items()])
def test_a_proxy_as_documented_has_nothing_to_correct_and_logs_no_address(tmp_path: Path, proxy: Proxy) -> None:
    assert failures(proxy, tmp_path) == []
    assert "remote_ip" not in "".join(log.read_text() for log in tmp_path.glob("caddy.log"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("proxy", "was", "by", "names"),
    [pytest.param(proxy, *change, marks=NEEDS[proxy]) for proxy, found in CHANGES.items() for change in found],
)
def test_one_setting_wrong_is_noticed(tmp_path: Path, proxy: Proxy, was: str, by: str, names: list[str]) -> None:
    assert failures(proxy, tmp_path, changed=(was, by)) == names


def logged_without_gateway(proxy: Proxy, folder: Path, *, changed: tuple[str, str] = ("", "")) -> str:
    """A proxy's log after somebody has come while nobody listens behind it."""
    ports = {"tls": free_port(), "http": free_port()}
    with proxy(folder, ports, free_port(), changed=changed):
        context = ssl.create_default_context(cafile=folder / "cert.pem")
        with pytest.raises(urllib.error.HTTPError, match="502"):
            urllib.request.urlopen(f"https://localhost:{ports['tls']}/join?id=canary", context=context, timeout=30)
    return "".join(path.read_text() for path in folder.glob("*.log"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("proxy", "setting", "address"),
    [
        pytest.param(nginx, "error_log /dev/null emerg;", "client: 127.0.0.1", marks=needs_nginx, id="nginx"),
        pytest.param(
            caddy,
            EXCLUDED,
            '"remote_ip":"127.0.0.1"',
            marks=needs_caddy,
            id="caddy",
        ),
    ],
)
def test_nothing_of_a_participant_is_logged_while_the_gateway_is_away(
    tmp_path: Path, proxy: Proxy, setting: str, address: str
) -> None:
    for name in ("documented", "without"):
        (tmp_path / name).mkdir()
    logged = logged_without_gateway(proxy, tmp_path / "documented")
    assert address not in logged
    assert "canary" not in logged
    assert address in logged_without_gateway(proxy, tmp_path / "without", changed=(setting, ""))


def logged_of_half_an_answer(folder: Path, *, changed: tuple[str, str] = ("", "")) -> str:
    """Caddy's log after the server behind it has ended in the middle of an answer."""
    ports = {"tls": free_port(), "http": free_port()}
    folder.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as behind:

        def answer() -> None:
            line, _ = behind.accept()
            with line:
                line.recv(65536)
                line.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\nhalf")

        ending = threading.Thread(target=answer, daemon=True)
        ending.start()
        with caddy(folder, ports, behind.getsockname()[1], changed=changed):
            context = ssl.create_default_context(cafile=folder / "cert.pem")
            url = f"https://localhost:{ports['tls']}/join?PROLIFIC_PID=canary"
            with (
                pytest.raises(http.client.IncompleteRead),
                urllib.request.urlopen(url, context=context, timeout=30) as got,
            ):
                got.read()
        ending.join(timeout=30)
    return (folder / "caddy.log").read_text()


@pytest.mark.slow
@needs_caddy
def test_caddy_logs_nothing_of_a_participant_whose_answer_breaks_off(tmp_path: Path) -> None:
    """Before 2.7 Caddy's line names neither address nor page: so it must be absent as a whole."""
    logged = logged_of_half_an_answer(tmp_path / "documented")
    assert not any(found in logged for found in ("remote_ip", "canary", "incomplete response"))
    changed = (EXCLUDED, "exclude http.log.error")
    assert "incomplete response" in logged_of_half_an_answer(tmp_path / "without", changed=changed)


@pytest.mark.parametrize(
    "directive",
    [
        "proxy_http_version 1.1;",
        "proxy_set_header Host $http_host;",
        "proxy_set_header X-Forwarded-For $remote_addr;",
        "proxy_set_header Upgrade $http_upgrade;",
        "proxy_set_header Connection $connection_upgrade;",
        "proxy_buffering off;",
        "access_log off;",
        "error_log /dev/null emerg;",
    ],
)
def test_the_document_names_what_the_test_proxy_does(directive: str) -> None:
    assert directive in text_of("nginx")


def test_the_document_names_files_that_never_leave_and_flags_that_exist() -> None:
    text = DEPLOY.read_text(encoding="utf-8")
    for name in ("secrets.json", "keys.json", "sessions.json", "secrets.toml", "pay.db"):
        assert f"`{name}`" in text
    known = {"--" + name.replace("_", "-") for name in ServeOptions.__dataclass_fields__} - {"--hosts"}
    known |= {"--host", "--dataset", "--url", "--link", "--insecure-ca", "--scenes-dir"}
    of_others = {"--system", "--group", "--home", "--env-file", "--detach", "--build", "--now", "--rm"}
    of_others |= {"--rotate", "--vacuum-time"}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) - of_others <= known
