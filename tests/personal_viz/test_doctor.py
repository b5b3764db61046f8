"""`study doctor` against a gateway behind a real TLS proxy: all is well, or one setting is wrong and is named."""

import asyncio
import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.asyncio.client import connect

from personal_viz.cli.study.doctor import StudyDoctor
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.operator import doctor
from personal_viz.study_app.operator.doctor import CHECKS, Finding, examine
from personal_viz.study_app.operator.doctor_site import site_from_url
from sim.errors import StudyError

from .gateways import PRESS, Running, enter, pack, running, small_config
from .tls_proxy import Settings, TlsProxy, self_signed, tls_proxy


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the speed of the machine that runs the tests no finding."""
    monkeypatch.setattr(doctor, "MAX_ROUND_TRIP_S", 60.0)
    monkeypatch.setattr(doctor, "MIN_MBIT_S", 0.0)


@contextmanager
def deployed(
    folder: Path, settings: Settings | None = None, *, days: int = 90, named: str = "127.0.0.1"
) -> Iterator[tuple[TlsProxy, Running]]:
    """A gateway as docs/deploy.md says, behind a proxy with these settings."""
    with tls_proxy(folder, settings, days=days) as proxy:
        options = ServeOptions(port=0, public=True, hosts=(f"localhost:{proxy.port}",), proxy=named, pilot=True)
        require_may_serve(options, small_config(), ["invented"])
        with running(folder, options=options) as gateway:
            proxy.set_behind(gateway.port)
            yield proxy, gateway


def examined(folder: Path, proxy: TlsProxy, link: str | None = None) -> dict[str, Finding]:
    """The report by name."""
    return examine(
        f"https://localhost:{proxy.port}", insecure_ca=folder / "cert.pem", http_port=proxy.http_port, link=link
    )


def failed(checks: dict[str, Finding]) -> list[str]:
    """Names of failures, with advice for each."""
    names = [name for name, check in checks.items() if check.passed is False]
    assert all(checks[name].advice for name in names)
    return names


def test_a_deployment_as_documented_has_nothing_to_correct(tmp_path: Path) -> None:
    with deployed(tmp_path) as (proxy, gateway):
        checks = examined(tmp_path, proxy, link=f"https://localhost:{proxy.port}/#good")
        assert failed(checks) == []
        assert all(check.passed for check in checks.values())
        assert list(checks) == [name for name, _ in CHECKS] + ["session"]
        assert checks["certificate"].detail.startswith("TLSv1.3, valid for 90 days")
        (sent,) = gateway.viser.received.values()
        assert [message["type"] for message in sent] == ["ViewerCameraMessage"]


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        (Settings(passes_upgrade=False), ["websocket"]),
        (Settings(passes_host=False), ["security headers", "foreign Host", "Origin", "cookie"]),
        (Settings(passes_address=False), ["proxy"]),
        (Settings(hides_headers=True), ["security headers"]),
        (Settings(strips_secure=True), ["cookie"]),
        (Settings(redirects=False), ["redirect"]),
    ],
)
def test_each_wrong_setting_of_the_proxy_is_named(tmp_path: Path, settings: Settings, names: list[str]) -> None:
    with deployed(tmp_path, settings) as (proxy, _):
        assert failed(examined(tmp_path, proxy)) == names


def test_a_slow_line_and_a_proxy_that_is_not_the_named_one_are_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "MAX_ROUND_TRIP_S", 0.0)
    monkeypatch.setattr(doctor, "MIN_MBIT_S", 1e9)
    with deployed(tmp_path, named="192.0.2.9") as (proxy, _):
        assert failed(examined(tmp_path, proxy)) == ["proxy", "round trip", "bandwidth"]


def test_a_certificate_that_ends_soon_or_is_not_trusted_fails(tmp_path: Path) -> None:
    with deployed(tmp_path, days=5) as (proxy, _):
        checks = examined(tmp_path, proxy)
        assert failed(checks) == ["certificate"]
        assert "5 days" in checks["certificate"].detail
        first, *rest = examine(f"https://localhost:{proxy.port}").values()
        assert first.passed is False
        assert "CERTIFICATE_VERIFY_FAILED" in first.detail
        assert all(check.passed is None for check in rest), "the rest would only repeat it"


def test_the_command_prints_lines_or_json_and_never_a_token(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with deployed(tmp_path) as (proxy, _):
        url = f"https://localhost:{proxy.port}"
        trusted = {"url": url, "insecure_ca": tmp_path / "cert.pem", "http_port": proxy.http_port}
        assert StudyDoctor(link=f"{url}/#canary", **trusted).run() == 1
        out = capsys.readouterr().out
        assert "FAIL  session: entering was refused (status 401). Copy a whole personal link" in out
        assert "canary" not in out
        assert out.endswith("1 of 13 checks failed\n")
        assert StudyDoctor(json=True, **trusted).run() == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["name"]: row["passed"] for row in rows} == {name: True for name, _ in CHECKS} | {"session": None}


def test_nobody_there_is_a_failure_with_advice(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        assert StudyDoctor(url=f"https://localhost:{free.getsockname()[1]}").run() == 1
    out = capsys.readouterr().out
    assert "FAIL  certificate: no answer (ConnectionRefusedError" in out
    assert "study serve are running" in out


def test_plain_http_of_the_laboratory_can_be_examined_too(tmp_path: Path) -> None:
    with running(tmp_path) as gateway:
        checks = examine(gateway.address, link=f"{gateway.address}/#good")
    assert failed(checks) == []
    assert {name for name, check in checks.items() if check.passed is None} == {"certificate", "redirect"}


@pytest.mark.parametrize(
    "url", ["study.example.org", "ftp://study.example.org", "https://", "https://a:b@c", "http://["]
)
def test_a_text_that_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(StudyError, match="is not the address of a study"):
        examine(url)


def test_a_link_of_another_address_and_a_bad_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"--link: does not begin with https://a\.org/#"):
        examine("https://a.org", link="https://b.org/#token")
    (tmp_path / "ca.pem").write_text("nothing")
    with pytest.raises(StudyError, match=r"--insecure-ca .*ca\.pem: cannot be used"):
        site_from_url("https://a.org", insecure_ca=tmp_path / "ca.pem", http_port=None)


def test_our_own_tls_serves_without_a_proxy(tmp_path: Path) -> None:
    certificate, key = self_signed(tmp_path)
    options = ServeOptions(port=0, public=True, hosts=("localhost",), tls_cert=certificate, tls_key=key, pilot=True)
    require_may_serve(options, small_config(), ["invented"])
    with running(tmp_path, options=options) as gateway:
        address = options.address(gateway.port)
        assert address == f"https://localhost:{gateway.port}"
        context = site_from_url(address, insecure_ca=certificate, http_port=None).context
        url, headers = enter(address, "good", context=context)
        assert url.startswith(f"wss://localhost:{gateway.port}/ws/")

        async def answer() -> str | bytes:
            async with connect(url, ssl=context, additional_headers=headers, proxy=None) as connection:
                await connection.send(pack(PRESS))
                return await asyncio.wait_for(connection.recv(), 20)

        assert asyncio.run(answer()) == b"GuiUpdateMessage"
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(address, timeout=20)  # nobody trusts it without the file
        assert failed(examine(address, insecure_ca=certificate)) == []
