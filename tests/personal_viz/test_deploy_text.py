"""The nginx text of DEPLOY.md is what works: a real nginx reads it where there is one, and its lines stay."""

import re
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import personal_viz
from personal_viz.doctor import examine
from personal_viz.gateway_options import ServeOptions

from .gateways import running, wait_until
from .tls_proxy import self_signed

DEPLOY = Path(personal_viz.__file__).parent / "DEPLOY.md"
NGINX = shutil.which("nginx")


def nginx_text() -> str:
    """As the document prints it."""
    found = re.search(r"```nginx\n(.*?)```", DEPLOY.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found.group(1)


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def is_answered(port: int) -> bool:
    """Whether somebody listens."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def nginx(folder: Path, ports: dict[str, int], behind: int, *, changed: tuple[str, str] = ("", "")) -> Iterator[None]:
    """The document's nginx in front of a port, with free ports, our certificate, and one setting changed."""
    certificate, key = self_signed(folder)
    text = nginx_text().replace(*changed) if changed[0] else nginx_text()
    places = {
        "listen 80;": f"listen 127.0.0.1:{ports['http']};",
        "listen 443 ssl;": f"listen 127.0.0.1:{ports['tls']} ssl;",
        "server_name study.example.org;": "server_name localhost;",
        "/etc/letsencrypt/live/study.example.org/fullchain.pem": str(certificate),
        "/etc/letsencrypt/live/study.example.org/privkey.pem": str(key),
        "127.0.0.1:8080": f"127.0.0.1:{behind}",
    }
    for found, place in places.items():
        assert found in text
        text = text.replace(found, place)
    temporary = " ".join(f"{kind}_temp_path {folder}/{kind};" for kind in ("client_body", "proxy", "fastcgi"))
    temporary += " ".join(f" {kind}_temp_path {folder}/{kind};" for kind in ("uwsgi", "scgi"))
    main = f"daemon off; pid {folder}/nginx.pid; error_log {folder}/error.log; events {{}}\n"
    (folder / "nginx.conf").write_text(f"{main}http {{ {temporary} access_log off;\n{text}\n}}\n")
    assert NGINX is not None
    process = subprocess.Popen([NGINX, "-p", str(folder), "-e", f"{folder}/error.log", "-c", f"{folder}/nginx.conf"])
    try:
        wait_until(lambda: is_answered(ports["tls"]) or process.poll() is not None)
        assert process.poll() is None, (folder / "error.log").read_text()
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=30)


def failures(folder: Path, *, changed: tuple[str, str] = ("", "")) -> list[str]:
    """What the doctor finds wrong with a gateway behind it."""
    ports = {"tls": free_port(), "http": free_port()}
    options = ServeOptions(port=0, public=True, hosts=(f"localhost:{ports['tls']}",), proxy="127.0.0.1", pilot=True)
    with running(folder, options=options) as gateway, nginx(folder, ports, gateway.port, changed=changed):
        url = f"https://localhost:{ports['tls']}"
        checks = examine(url, link=f"{url}/#good", insecure_ca=folder / "cert.pem", http_port=ports["http"])
    assert all(check.passed is not None for check in checks)
    return [check.name for check in checks if not check.passed]


@pytest.mark.slow
@pytest.mark.skipif(NGINX is None, reason="found no nginx; install it to check the text of DEPLOY.md")
def test_nginx_as_documented_has_nothing_to_correct(tmp_path: Path) -> None:
    assert failures(tmp_path) == []


@pytest.mark.slow
@pytest.mark.skipif(NGINX is None, reason="found no nginx; install it to check the text of DEPLOY.md")
@pytest.mark.parametrize(
    ("changed", "names"),
    [
        (("$http_host;", "$host;"), ["security headers", "Origin", "cookie", "session"]),
        (("proxy_set_header Upgrade $http_upgrade;", ""), ["websocket", "session"]),
        (("proxy_set_header X-Forwarded-For $remote_addr;", ""), ["proxy"]),
        (("return 308 https://$host$request_uri;", "return 200 hello;"), ["redirect"]),
    ],
)
def test_nginx_with_one_setting_wrong_is_noticed(tmp_path: Path, changed: tuple[str, str], names: list[str]) -> None:
    assert failures(tmp_path, changed=changed) == names


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
    ],
)
def test_the_document_names_what_the_test_proxy_does(directive: str) -> None:
    assert directive in nginx_text()


def test_the_document_names_files_that_never_leave_and_flags_that_exist() -> None:
    text = DEPLOY.read_text(encoding="utf-8")
    for name in ("secrets.json", "keys.json", "sessions.json", "secrets.toml", "pay.db"):
        assert f"`{name}`" in text
    known = {"--" + name.replace("_", "-") for name in ServeOptions.__dataclass_fields__} - {"--hosts"}
    known |= {"--host", "--dataset", "--url", "--link", "--insecure-ca"}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) <= known
