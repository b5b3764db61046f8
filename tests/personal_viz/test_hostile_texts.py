"""Hostile texts through every door that a participant has; they end as text in pages, tables, reports and the terminal.

A study is served as from a terminal. One participant sends each text in every field, header, address and message; then
each output is read: pages and answers, the dashboard, `status`, `check-db`, the report, the export and the log.
"""

import contextlib
import csv
import io
import json
import re
import signal
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from urllib.parse import quote, urlencode

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from human_study.design.study import StudyPractice, StudyRecruit, StudySurvey, load_study
from human_study.export.text_tables import csv_lines, one_cell, tex
from human_study.report.page import html_page
from human_study.texts.survey import SURVEY
from personal_viz.bots.forms import DEVICE, Session, answer_pages, ask, open_session, right_answers
from personal_viz.bots.page import BotPage
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.operator.served import serve_command, served

from .flow_studies import plan_small
from .gateways import raw
from .html_tags import Tags
from .program import personal_viz
from .wire import WireClient, line_to

pytestmark = pytest.mark.slow
MARK = "zq7mark"
"""Is in every hostile text and nowhere else."""
FORGED = f"personal-viz: {MARK} forged, the study has ended"
HOSTILE = {
    "script": f"<script>alert('{MARK}')</script>",
    "attribute": f"\"'><img src=x onerror=alert('{MARK}')>",
    "link": f"[{MARK}](javascript:alert(1)) ![{MARK}](http://evil.test/x.png) | cell |",
    "template": f"{{{{ {MARK}.__class__ }}}} {{% raw %}} ${{{MARK}}}",
    "equals": f'=HYPERLINK("http://evil.test/{MARK}")',
    "plus": f"+cmd|'/c {MARK}'!A1",
    "minus": f"-2+3+cmd|'{MARK}'!A1",
    "at": f"@SUM({MARK})",
    "tab": f"\t={MARK}",
    "return": f"\r={MARK}",
    "lines": f"{MARK}\n{FORGED}\r\n{FORGED}",
    "terminal": f"\x1b[2J\x1b]0;{MARK}\x07\x9b31m",
    "direction": f"{MARK}\u202egnp.exe\u2066\u200f\u2028",
    "latex": rf"{MARK} \input{{/etc/passwd}} \write18{{rm}} ~^%$&#_",
    "zero": f"{MARK}\x00after",
}
COMMENT = "\n".join([HOSTILE["equals"], *HOSTILE.values()])
COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Characters that steer a terminal, end a line in it, or turn the direction of its text."""
FIELDS = ("choice", "at", "answer", "width", "height", "webgl2", "pressed", "page", "eligible_0", "comment", *SURVEY)


@dataclass(frozen=True)
class Ended:
    """Everything that came out of the study."""

    terminal: str
    """All that the server and commands wrote for people."""
    answers: tuple[str, ...]
    """What the gateway and the dashboard answered."""
    files: Mapping[str, str]
    """Files of the report and of the export, by name."""

    def named(self, end: str) -> dict[str, str]:
        found = {name: text for name, text in self.files.items() if name.endswith(end)}
        assert found
        return found


def through_addresses_and_headers(address: str, text: str) -> Iterator[str]:
    """Paths, queries, headers, entry and joining."""
    for path in (f"/{quote(text)}", f"/page/{quote(text)}/", f"/view/?websocket={quote(text)}", f"/?{quote(text)}"):
        yield ask(address, path).text
    host = address.removeprefix("http://")
    for name in ("User-Agent", "Referer", "X-Forwarded-For", "Cookie", "Origin", "Accept-Language", "X-" + MARK):
        sent = f"GET /join HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{name}: {text}\r\n\r\n"
        yield raw(int(host.rpartition(":")[2]), sent.encode()).decode("utf-8", "replace")
    device = {"webgl2": text, "width": text, "height": text, "dpr": text, "touch": text}
    for path, body in (
        ("/enter", {"token": text, "device": device}),
        ("/join", {"PROLIFIC_PID": text, "STUDY_ID": text, "SESSION_ID": text}),
        ("/join", {text: text}),
    ):
        yield ask(address, path, body=json.dumps(body), kind="application/json").text


def through_forms(session: Session, text: str) -> Iterator[str]:
    """The present page with the text in every field, alone and beside right ones, and in the page's address."""
    yield ask(session.origin, f"{session.page}?page={quote(text)}", cookie=session.cookie).text
    right = re.search(r'name="at" value="([^"]*)"', ask(session.origin, session.page, cookie=session.cookie).text)
    forms = [dict.fromkeys(FIELDS, text), {text: text}]
    if right is not None:
        forms += [{**DEVICE, "at": right[1], name: text} for name in FIELDS if name != "at"]
    for form in forms:
        yield ask(session.origin, session.page, cookie=session.cookie, body=urlencode(form)).text


def through_a_websocket(session: Session, text: str) -> None:
    """Messages that the gateway closes the connection for: a text, wrong fields, a subprotocol."""
    url, headers = session.view.split("websocket=")[1], {"Cookie": session.cookie, "Origin": session.origin}
    hostile = [
        text,
        msgspec.msgpack.encode({"type": text}),
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": text, "updates": {"value": text}}),
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "a", "updates": {text: text}}),
    ]
    for message in hostile:
        with line_to(url, additional_headers=headers) as connection, contextlib.suppress(ConnectionClosed):
            connection.send(msgspec.msgpack.encode(CAMERA))
            connection.send(message)
            while True:
                connection.recv(timeout=60)
    with contextlib.suppress(InvalidStatus), line_to(f"{url}/{quote(text)}", additional_headers=headers):
        pass


def through_the_pages_script(session: Session) -> None:
    """Letters of the page's script under the right name of the connection, and strings in its hidden field."""
    url, headers = session.view.split("websocket=")[1], {"Cookie": session.cookie, "Origin": session.origin}
    with line_to(url, additional_headers=headers) as connection:
        connection.send(msgspec.msgpack.encode(CAMERA))
        page = BotPage()
        while page.seat is None or page.letter_box is None:
            data = connection.recv(timeout=60)
            assert isinstance(data, bytes)
            page.apply(data)
        for text in HOSTILE.values():
            told = {"n": 0, "t_cli_ms": 1.0}
            for said in (
                {"kind": "told", "name": text[:32], **told},
                {"kind": text, **told},
                {"kind": "press", "action": "forward", "code": text, **told},
                {"kind": "keys", "keys": {"forward": text}, **told},
                text,
            ):
                value = json.dumps({"seat": page.seat, "said": [said]})
                message = {"type": "GuiUpdateMessage", "uuid": page.letter_box.uuid, "updates": {"value": value}}
                time.sleep(0.06)  # a page's pace: what is faster is dropped
                connection.send(msgspec.msgpack.encode(message))


def commented(session: Session, text: str) -> str:
    """The last page after a comment."""
    shown = ask(session.origin, session.page, cookie=session.cookie).text
    (at,) = set(re.findall(r'name="at" value="([^"]*)"', shown))
    form = urlencode({"at": at, "choice": "comment", "comment": text})
    assert ask(session.origin, session.page, cookie=session.cookie, body=form).status == 303
    return ask(session.origin, session.page, cookie=session.cookie).text


def through_later_pages(link: str, right: frozenset[str]) -> Iterator[str]:
    """Gives up every trial; sends everything in the forms of the breaks, the survey and the last page."""
    while True:
        session = open_session(link)
        for text in HOSTILE.values():
            yield from through_forms(session, text)
        last = answer_pages(session, right)
        if last is not None:
            assert last.place == "finished"
            yield commented(session, COMMENT)
            for text in HOSTILE.values():
                yield from through_forms(session, text)
            return
        headers = {"Cookie": session.cookie, "Origin": session.origin}
        with line_to(session.view.split("websocket=")[1], additional_headers=headers) as connection:
            client = WireClient(connection)
            client.send(CAMERA)
            client.give_up()
            client.receive_until(lambda message: "personalPage.goOn" in str(message))


def of_dashboard(link: str) -> Iterator[str]:
    """The researcher's page, and what its script asks for."""
    origin, _, token = link.partition("/#")
    yield ask(origin, "/").text
    yield ask(origin, "/progress", cookie=ask(origin, "/enter", body=token).cookie).text


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    """A study in which somebody sent everything everywhere, took part, and finished."""
    root = tmp_path_factory.mktemp("hostile")
    folder = plan_small(
        root,
        practice=StudyPractice(pan=0, pog=0),
        recruit=StudyRecruit(kind="link"),
        comments=True,
        survey=StudySurvey(questions=tuple(SURVEY), eligibility=("I am an adult.",)),
    )
    answers, right, log = list[str](), right_answers(load_study(folder)), root / "serve.log"
    command = serve_command(folder, root / "dataset", port=0, workers=1)
    with log.open("w") as errors, served(command, stderr=errors) as program:
        link = program.people[0].link
        for text in HOSTILE.values():
            answers += through_addresses_and_headers(link.partition("/#")[0], text)
        session = open_session(link)
        for text in HOSTILE.values():
            answers += through_forms(session, text)
        assert answer_pages(session, right) is None
        for text in HOSTILE.values():
            through_a_websocket(session, text)
        through_the_pages_script(session)
        answers += through_later_pages(link, right)
        dashboard = re.search(r"for you only: (\S+)", program.said)
        assert dashboard is not None
        answers += of_dashboard(dashboard[1])
        program.process.send_signal(signal.SIGINT)
        output, _ = program.process.communicate(timeout=60)
    told = [personal_viz("study", verb, folder) for verb in ("status", "check-db")]
    told += [personal_viz("study", verb, folder, "--out", root / verb) for verb in ("report", "export")]
    assert all(done.returncode == 0 for done in told), told
    files = {
        str(path.relative_to(root)): path.read_text()
        for verb in ("report", "export")
        for path in (root / verb).rglob("*")
        if path.is_file() and path.suffix != ".parquet"
    }
    said = [text for done in told for text in (done.stdout, done.stderr)]
    return Ended("\n".join([program.said, output, log.read_text(), *said]), tuple(answers), files)


def test_no_text_steers_the_terminal_or_forges_a_line_in_it(ended: Ended) -> None:
    assert "a connection of p01 was closed: it sent a message that is damaged or not allowed" in ended.terminal
    assert COMMANDS.findall(ended.terminal) == []
    assert not [line for line in ended.terminal.splitlines() if line.startswith(FORGED)]


def assert_harmless(page: str) -> None:
    """No text of a participant became a part of the page other than text."""
    for name, given in Tags(page).found:
        harmful = [key for key, value in given.items() if MARK in f"{key}{value}" and key not in ("value", "alt")]
        assert not harmful, (name, given)
    assert not re.search(rf"<script[^>]*>[^<]*{MARK}", page)
    assert "javascript:" not in "".join(str(given.get("href")) for _, given in Tags(page).found)


def test_no_text_becomes_a_part_of_a_page(ended: Ended) -> None:
    pages = [text for text in ended.answers if "<html" in text]
    assert len(pages) > 100
    pages += [*ended.named(".html").values(), *ended.named(".svg").values()]
    for page in pages:
        assert_harmless(page)


def test_answers_that_are_no_pages_repeat_nothing(ended: Ended) -> None:
    assert not [text for text in ended.answers if "<html" not in text and MARK in text]


def test_no_cell_of_a_table_is_a_formula(ended: Ended) -> None:
    tables = ended.named(".csv")
    assert {"export/events.csv", "report/report.csv"} <= set(tables)
    for name, text in tables.items():
        for row in csv.reader(io.StringIO(text)):
            for cell in row:
                is_number = re.fullmatch(r"-?[\d.]+(e[-+]?\d+)?", cell) is not None
                assert is_number or not cell.startswith(("=", "+", "-", "@", "\t", "\r")), (name, cell)


def test_a_comment_comes_out_word_by_word_in_its_own_table_and_nowhere_else(ended: Ended) -> None:
    (line,) = ended.files["export/comments.jsonl"].splitlines()
    comment = json.loads(line)["comment"]
    (_, row) = csv.reader(io.StringIO(ended.files["export/comments.csv"]))
    assert comment in (row[-1], row[-1].removeprefix("'"))
    assert comment.startswith(HOSTILE["equals"])
    for name in ("script", "attribute", "link", "template", "plus", "minus", "at", "latex"):
        assert HOSTILE[name] in comment, name
    others = {name: text for name, text in ended.files.items() if not name.startswith("export/comments.")}
    assert not [name for name, text in others.items() if MARK in text]


def test_no_text_is_a_command_of_latex(ended: Ended) -> None:
    for name, text in ended.named(".tex").items():
        assert not re.search(rf"\\(input|write18)|{MARK}[^\n]*(?<!\\)[%$&#_^~]", text), name


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_text_in_a_cell_stays_a_text(text: str) -> None:
    """The tables' own writers, for texts that no participant can send today."""
    (row,) = csv.reader(io.StringIO(csv_lines([], [[text]]).removeprefix("\n")))
    assert row[0].lstrip("'") == text.lstrip("'")
    assert not row[0].startswith(("=", "+", "-", "@", "\t", "\r"))
    written = tex(text)
    assert not re.search(r"\\(input|write)", written)
    assert not re.search(r"(?<!\\)[%$&#_]", written)
    assert_harmless(html_page(f"# Report\n\n| a | b |\n|---|---|\n| {one_cell(text)} | b |\n", {}))
