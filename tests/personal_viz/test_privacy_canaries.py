"""A public study behind a proxy: `study doctor` finds nothing, and a visitor whose browser tells a lot leaves no trace.

The visitor's browser, address and platform id are in no file, output or export.
"""

import http.cookies
import json
import signal
import urllib.request
from pathlib import Path

import pytest

from human_study.design.study import StudyPractice, StudyPrivacy, StudyRecruit
from human_study.export.study_export import export_study
from personal_viz.cli.study.doctor import StudyDoctor
from personal_viz.study_app.operator import doctor
from personal_viz.study_app.operator.served import free_port, serve_command, served
from personal_viz.study_app.recruit_codes import CODES_FILE

from .flow_studies import plan_small
from .tls_proxy import tls_proxy
from .wire import CAMERA, WireClient, line_to

pytestmark = pytest.mark.slow
AGENT, ADDRESS, PLATFORM_ID = "CanaryBrowser/99.5", "203.0.113.77", "5f9canaryplatformid77"
CODES = '[prolific]\ncompletion = "CDONE1"\nscreen_out = "COUT01"\nno_consent = "CNO001"\n'
TELLING = {
    "User-Agent": AGENT,
    "X-Forwarded-For": ADDRESS,
    "X-Real-IP": ADDRESS,
    "Forwarded": f"for={ADDRESS}",
    "Accept-Language": "canary-CA",
    "Referer": f"https://canary.example/{PLATFORM_ID}",
    "Content-Type": "application/json",
}


def post(address: str, path: str, body: dict) -> tuple[dict, str]:
    """The answer and its cookie, as a browser that tells all it can gets them."""
    request = urllib.request.Request(f"{address}{path}", json.dumps(body).encode(), {**TELLING, "Origin": address})
    with urllib.request.urlopen(request, timeout=60) as reply:
        cookie = http.cookies.SimpleCookie(reply.headers.get("Set-Cookie", ""))
        return json.load(reply), "; ".join(f"{name}={morsel.value}" for name, morsel in cookie.items())


def visit(address: str) -> None:
    """Comes through the open link with Prolific's parameters and looks at the first page."""
    visitor = {"PROLIFIC_PID": PLATFORM_ID, "STUDY_ID": "canarystudy", "SESSION_ID": "canarysession"}
    joined, _ = post(address, "/join", visitor)
    entered, cookie = post(address, "/enter", {"token": joined["token"]})
    headers = {**TELLING, "Cookie": cookie, "Origin": address}
    url = entered["view"].split("websocket=")[1]
    with line_to(url, additional_headers=headers, user_agent_header=None) as connection:
        client = WireClient(connection)
        client.send(CAMERA)
        client.receive_until(lambda message: "Step 0 of" in str(message) or "button" in str(message).lower())


def test_a_public_study_has_nothing_to_correct_and_nothing_tells_who_a_visitor_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "MAX_ROUND_TRIP_S", 60.0)  # the speed of this machine is no finding
    monkeypatch.setattr(doctor, "MIN_MBIT_S", 0.0)
    folder = plan_small(
        tmp_path,
        recruit=StudyRecruit(kind="prolific"),
        privacy=StudyPrivacy(platform_id="none"),
        flow=("instructions",),
        practice=StudyPractice(pan=0, pog=0),
    )
    (folder / CODES_FILE).write_text(CODES)
    (tmp_path / "proxy").mkdir()
    port = free_port()
    with tls_proxy(tmp_path / "proxy") as proxy:
        proxy.set_behind(port)
        host = f"localhost:{proxy.port}"
        public = ("--public", "--proxy", "127.0.0.1", "--host", host)
        command = serve_command(folder, tmp_path / "dataset", *public, port=port, workers=1)
        with (tmp_path / "said.txt").open("w") as errors, served(command, stderr=errors) as program:
            visit(f"http://127.0.0.1:{port}")
            link = program.people[-1].link
            assert link.startswith(f"https://{host}/#")
            cert = tmp_path / "proxy" / "cert.pem"
            looked = StudyDoctor(f"https://{host}", link=link, insecure_ca=cert, http_port=proxy.http_port).run()
            program.process.send_signal(signal.SIGINT)
            output, _ = program.process.communicate(timeout=60)
    report = capsys.readouterr().out
    assert (looked, report.splitlines()[-1]) == (0, f"https://{host}: nothing to correct"), report
    assert "pass  session: the first message came after" in report
    export_study(folder, tmp_path / "out")
    (tmp_path / "out.txt").write_text(program.said + output + report)
    canaries = (AGENT, ADDRESS, PLATFORM_ID, "canary-CA", "canarystudy", "canarysession")
    for path in [path for path in tmp_path.rglob("*") if path.is_file() and "dataset" not in path.parts]:
        content = path.read_bytes()
        assert not [text for text in canaries if text.encode() in content], path
    rows = [json.loads(line) for line in (tmp_path / "out" / "participants.jsonl").read_text().splitlines()]
    assert sum(row["has_come"] for row in rows) == 1
