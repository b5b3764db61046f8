"""The pages of a study that are HTML forms: when each is shown, and what each answer stores, once."""

import html
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from human_study.export.study_export import export_study
from human_study.journey import Stage
from human_study.report.source import read_survey
from human_study.store.records import read_study
from human_study.store.store import StudyStore
from human_study.store.writer import StoreFullError
from human_study.texts.quiz import questions_for
from human_study.texts.survey import SURVEY
from personal_viz.bots.forms import LastPage, Reply, Session, answer_pages, right_answers
from personal_viz.study_app.gateway.admission import Tickets
from personal_viz.study_app.gateway.app import Gateway
from personal_viz.study_app.gateway.device import device_report
from personal_viz.study_app.gateway.lease_keeper import LeaseKeeper
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.gateway.pages import Pages
from personal_viz.study_app.recruit_codes import EndCode
from tests.human_study.small_world import CANARY
from tests.human_study.stores import do_next, started, trials_of

from .gateways import OnePort, admission_for, few_people
from .html_tags import Tags

CODE, ORIGIN = "p01", "http://127.0.0.1"
DEVICE = {"webgl2": "1", "width": "1280", "height": "800", "pressed": "1", "choice": "continue"}
TEXTS = {
    "told/consent-pan.md": "# May we?\n\nWe keep **keys**.",
    "told/instructions-pan.md": "# Hello\n\nWelcome here.",
}


@dataclass
class Taking:
    """A participant in a browser without JavaScript, and what is stored."""

    client: TestClient
    store: StudyStore
    address: str
    keeper: LeaseKeeper

    def page(self, **query: str) -> str:
        """The page that is shown; '' = viser comes next."""
        reply = self.client.get(self.address, params=query, follow_redirects=False)
        if reply.status_code == 303:
            assert reply.headers["location"].startswith("/view/?websocket=")
            return ""
        assert reply.status_code == 200, reply.text
        require_readable(reply.text)
        return html.unescape(reply.text)

    def place(self) -> str:
        """The participant's place according to the page."""
        return re.findall(r'data-place="(\w*)"', self.page() or 'data-place="viser"')[0]

    def send(self, **fields: str) -> Any:
        """Posts the form that is shown now."""
        at = re.findall(r'name="at" value="([^"]*)"', self.page(page="99"))[0]
        return self.post({"at": at, **fields})

    def post(self, fields: dict[str, str], *, origin: str | None = ORIGIN) -> Any:
        """Posts a form."""
        headers = {} if origin is None else {"origin": origin}
        return self.client.post(self.address, data=fields, headers=headers, follow_redirects=False)

    def stages(self) -> list[str]:
        """Names of the stored stages."""
        return [entry.stage for entry in self.store.participant(CODE).stages]

    def last_detail(self) -> dict[str, Any]:
        """The detail of the newest stage."""
        return self.store.participant(CODE).stages[-1].detail


def require_readable(text: str) -> None:
    """Every element of a page is closed, and every picture has words to be read aloud."""
    tags = Tags(text)
    assert tags.is_balanced
    assert text.count("<h1>") == text.count("<main") == 1
    assert re.search(r'<html lang="\w\w">', text)
    for tag, attributes in tags.found:
        assert not set(attributes) & {"style", "onclick", "onerror"}
        assert tag != "img" or attributes["alt"]


@pytest.fixture
def taking(tmp_path: Path) -> Callable[..., Taking]:
    """Makes the only participant of a study with an episode in each of three homes, who has just opened the link."""

    def make(end: EndCode | None = None, **choices: Any) -> Taking:
        usual: dict[str, Any] = {
            "design": {"kind": "crossed", "raters_per_episode": 1},
            "flow": ("device", "consent", "instructions", "quiz"),
            "breaks": {"every": None, "sitting_max": None},
        }
        store = started(tmp_path / "study", **{**usual, **choices})
        tickets, keeper = Tickets(), LeaseKeeper(store, tell=lambda _: None)
        gateway = Gateway(
            admission_for(few_people(), tmp_path),
            OnePort(9),
            tickets=tickets,
            options=ServeOptions(),
            pages=Pages(store, texts=TEXTS, end_code=lambda *_: end or EndCode("ABCD1234")),
            present=keeper.present,
            tell=lambda _: None,
        )
        client = TestClient(gateway.app(), base_url=ORIGIN, client=("192.0.2.7", 5000))
        reply = client.post("/enter", json={"token": "good"}, headers={"origin": ORIGIN})
        return Taking(client, store, reply.json()["page"], keeper)

    return make


def enter(who: Taking, *stages: Stage) -> None:
    """Stores stages that the participant has reached."""
    for stage in stages:
        who.store.enter_stage(CODE, stage)


def test_a_participant_comes_from_the_link_to_viser_and_each_answer_is_stored(taking: Callable[..., Taking]) -> None:
    who = taking()
    assert "Checking your browser" in who.page()
    assert who.stages() == ["arrived"]
    assert who.send(**DEVICE).status_code == 303
    assert who.last_detail() == {"webgl2": True, "width": 1300, "height": 800, "keyboard": True, "buttons": False}
    assert "<h1>May we?</h1>" in who.page()
    assert "<strong>keys</strong>" in who.page()
    who.send(choice="agree")
    assert "<h1>Hello</h1>" in who.page()
    assert "I have read this" not in who.page()
    assert "Page 2 of" in who.page(page="2")
    last = who.page(page="99")
    assert "I have read this" in last
    who.send(choice="read")
    assert who.last_detail() == {"after_failed_rounds": 0}
    for question in questions_for(who.store.config, "pan", ("none",)):
        assert question.text in who.page()
        who.send(answer=question.answers[0])
    assert who.last_detail() == {"round": 1, "wrong": []}
    assert who.page() == ""
    assert who.stages() == ["arrived", "device_ok", "consented", "instructed", "quiz_passed"]


def test_declining_is_an_answer_that_is_stored_and_stays(taking: Callable[..., Taking]) -> None:
    who = taking(end=EndCode())
    who.send(**DEVICE)
    who.send(choice="decline")
    assert who.place() == "declined"
    assert "Leave the study" not in who.page()
    answer = who.store.participant(CODE).consent
    assert not answer.given
    assert all(trial.is_released for trial in trials_of(who.store, CODE))


def test_a_form_that_is_sent_twice_answers_once_and_an_old_one_nothing(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent", "quiz"))
    at = re.findall(r'name="at" value="([^"]*)"', who.page())[0]
    for choice in ("agree", "agree", "decline"):
        assert who.post({"at": at, "choice": choice}).status_code == 303
    assert who.stages() == ["arrived", "consented"]
    first, second, *_ = questions_for(who.store.config, "pan", ("none",))
    at = re.findall(r'name="at" value="([^"]*)"', who.page())[0]
    for _ in range(3):
        who.post({"at": at, "answer": first.answers[0]})
    assert second.text in who.page()
    assert "Not quite" not in who.page()


@pytest.mark.parametrize("origin", ["http://evil.test", "null", None, "https://127.0.0.1"])
def test_a_form_of_another_site_is_refused(taking: Callable[..., Taking], origin: str | None) -> None:
    who = taking(flow=("consent",))
    at = re.findall(r'name="at" value="([^"]*)"', who.page())[0]
    assert who.post({"at": at, "choice": "agree"}, origin=origin).status_code == 403
    assert who.stages() == ["arrived"]


def test_without_the_cookie_or_with_an_old_ticket_there_is_no_page(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",))
    stranger = TestClient(who.client.app, base_url=ORIGIN)
    for address in (who.address, f"{who.address}leave", "/page/none/"):
        assert "data-place" not in stranger.get(address).text
    assert stranger.post(who.address, data={"choice": "withdraw"}, headers={"origin": ORIGIN}).status_code == 200
    with pytest.raises(WebSocketDisconnect), stranger.websocket_connect(f"ws://127.0.0.1{who.address}here"):
        pass
    assert "withdrawn" not in who.stages()
    again = who.client.post("/enter", json={"token": "good"}, headers={"origin": ORIGIN}).json()["page"]
    assert again != who.address
    assert "data-place" not in who.client.get(who.address).text


def test_the_cookie_of_the_pages_is_theirs_alone(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",))
    reply = who.client.post("/enter", json={"token": "good"}, headers={"origin": ORIGIN})
    cookies = reply.headers.get_list("set-cookie")
    assert {cookie.partition("Path=")[2].partition(";")[0].rpartition("/")[0] for cookie in cookies} == {"/ws", "/page"}
    assert all("HttpOnly" in cookie and "SameSite=strict" in cookie for cookie in cookies)
    page = who.client.get(reply.json()["page"])
    assert page.headers["referrer-policy"] == "same-origin"  # with no-referrer, browsers send no Origin with a form
    assert "script" not in page.headers["content-security-policy"].replace("default-src 'self'", "")
    assert page.headers["cache-control"] == "no-store"


def test_an_open_page_keeps_its_participant_here(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",))
    with who.client.websocket_connect(f"ws://127.0.0.1{who.address}here", headers={"origin": ORIGIN}):
        assert who.keeper.people_here() == {CODE}
    assert who.keeper.people_here() == frozenset()
    with (
        pytest.raises(WebSocketDisconnect),
        who.client.websocket_connect(f"ws://127.0.0.1{who.address}here", headers={"origin": "http://evil.test"}),
    ):
        pass


def test_a_computer_that_cannot_show_the_study_is_noted_once_for_each_kind(taking: Callable[..., Taking]) -> None:
    who = taking(recruit={"kind": "prolific"})
    small = {**DEVICE, "width": "800", "choice": ""}
    at = re.findall(r'name="at" value="([^"]*)"', who.page())[0]
    for width in ("800", "810", "700", "800"):
        who.post({**small, "at": at, "width": width})
    assert who.stages() == ["arrived", "device_failed", "device_failed"]
    assert who.place() == "device"
    who.post({**DEVICE, "at": at, "pressed": "0", "choice": "buttons"})  # the page needs no loading after a failure
    assert who.stages()[-1] == "device_ok"
    assert who.last_detail()["buttons"]


def test_a_person_from_a_platform_can_go_back_to_it(taking: Callable[..., Taking]) -> None:
    who = taking(recruit={"kind": "prolific"}, end=EndCode("SCREEN1", "https://app.prolific.com/x?cc=SCREEN1"))
    who.send(**{**DEVICE, "width": "800", "choice": "leave"})
    assert who.stages() == ["arrived", "device_failed", "screened_out"] or who.stages() == ["arrived", "screened_out"]
    shown = who.page()
    assert "This study cannot be shown here" in shown
    assert 'href="https://app.prolific.com/x?cc=SCREEN1"' in shown


@pytest.mark.parametrize(
    "form", [{}, {"width": "x", "height": "1"}, {"width": "-1", "height": "1"}, {"width": "²", "height": "1"}]
)
def test_a_damaged_device_form_gives_no_report(form: dict[str, str]) -> None:
    assert device_report(form) is None


def test_wrong_answers_are_explained_and_twice_wrong_leads_back_to_the_instructions(
    taking: Callable[..., Taking],
) -> None:
    who = taking(flow=("instructions", "quiz"))
    enter(who, "arrived", "instructed")
    questions = questions_for(who.store.config, "pan", ("none",))

    def answer_all(wrong: str) -> None:
        for question in questions:
            if question.text in who.page():
                if question.name == wrong:
                    who.send(answer=question.answers[1])
                    assert 'role="alert"' in who.page()
                    assert "Not quite." in who.page()
                who.send(answer=question.answers[0])

    answer_all(questions[1].name)
    assert who.last_detail() == {"round": 1, "wrong": [questions[1].name]}
    assert "answer these questions once more" in who.page()
    assert "Question 1 of 1" in who.page()  # the second round asks only what was wrong
    answer_all(questions[1].name)
    assert who.place() == "instructions"
    assert "Please read this once more" in who.page()
    who.send(choice="read")
    assert who.last_detail() == {"after_failed_rounds": 2}
    assert f"Question 1 of {len(questions)}" in who.page()


def test_a_break_and_the_end_of_a_sitting_are_stored_when_they_begin_and_when_they_end(
    taking: Callable[..., Taking],
) -> None:
    who = taking(flow=(), breaks={"every": 1, "sitting_max": 2, "sitting_gap_s": 3000.0})
    enter(who, "arrived")
    do_next(who.store, CODE)
    assert "Time for a break" in who.page()
    assert "1 of 3 searches done" in who.page()
    assert who.stages() == ["arrived", "break_started"]
    who.send(choice="next")
    assert who.page() == ""
    do_next(who.store, CODE)
    shown = who.page()
    assert "in 50 minutes or later" in shown
    assert "See if I can go on" in shown
    at = re.findall(r"pause-\d+-0", "pause-4-0")[0]
    who.post({"at": at, "choice": "next"})
    assert who.stages()[-1] == "break_started"
    assert who.last_detail()["sitting"]


def test_a_person_who_has_done_everything_gets_a_code(taking: Callable[..., Taking]) -> None:
    who = taking(flow=())
    for _ in range(3):
        assert who.page() == ""
        do_next(who.store, CODE)
    shown = who.page()
    assert who.stages() == ["arrived", "finished"]
    assert 'aria-label="Completion code">ABCD1234<' in shown
    assert "Leave the study" not in shown
    assert who.client.get(f"{who.address}leave", follow_redirects=False).status_code == 303


def finish(who: Taking) -> Taking:
    """The same person after all searches."""
    for _ in range(3):
        assert who.page() == ""
        do_next(who.store, CODE)
    return who


def stored_comment(who: Taking) -> str | None:
    """The participant's comment in the records; None = there is none."""
    with read_study(who.store.folder) as reader:
        return reader.answers("comment").get(CODE)


def test_the_last_page_has_a_button_to_copy_the_code_and_says_what_the_study_is_about(
    taking: Callable[..., Taking], tmp_path: Path
) -> None:
    shown = finish(taking(flow=())).page()
    assert "<h2>What this study is about</h2>" in shown
    assert "Nobody is judged as a person." in shown
    assert ">Copy the code</button>" in shown
    assert 'data-done="The code is copied."' in shown
    assert "<textarea" not in shown


def test_without_a_code_there_is_nothing_to_copy(taking: Callable[..., Taking]) -> None:
    assert "Copy the code" not in finish(taking(end=EndCode(None), flow=())).page()


def test_a_study_has_its_own_text_at_the_end(taking: Callable[..., Taking], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TEXTS, "told/debriefing-pan.md", "# Why we asked\n\nTo learn about **mugs**.")
    shown = finish(taking(flow=())).page()
    assert "<h2>Why we asked</h2>" in shown
    assert "<strong>mugs</strong>" in shown
    assert "What this study is about" not in shown


def test_a_comment_is_stored_once_as_plain_text(taking: Callable[..., Taking]) -> None:
    who = finish(taking(flow=(), comments=True))
    shown = who.page()
    assert '<textarea id="comment" name="comment" maxlength="2000" rows="4" required></textarea>' in shown
    who.send(choice="comment", comment=" \r\n\t ")
    assert stored_comment(who) is None
    (at,) = re.findall(r'name="at" value="([^"]*)"', shown)
    who.send(choice="comment", comment="=1+1 <b>\r\nThe \x1b[31mmug\u202e was\x00 hidden 😀 ")
    assert stored_comment(who) == "=1+1 <b>\nThe  [31mmug  was  hidden 😀"
    who.post({"at": at, "choice": "comment", "comment": "once more"})
    assert stored_comment(who) == "=1+1 <b>\nThe  [31mmug  was  hidden 😀"
    shown = who.page()
    assert "Your comment is stored." in shown
    assert "<textarea" not in shown
    assert "mug" not in shown
    assert who.stages()[-1] == "finished"


def test_a_comment_of_any_letters_fits_and_the_rest_of_a_longer_one_is_cut(taking: Callable[..., Taking]) -> None:
    who = finish(taking(flow=(), comments=True))
    who.send(choice="comment", comment="😀" * 2001)
    assert stored_comment(who) == "😀" * 2000


@pytest.mark.parametrize("comments", [False, True])
def test_no_comment_is_taken_where_nobody_asked_for_it(taking: Callable[..., Taking], comments: bool) -> None:
    who = taking(flow=(), comments=comments)
    who.post({"at": "trial-1-0", "choice": "comment", "comment": "too early"})
    assert stored_comment(who) is None
    if not comments:
        finish(who).page()
        who.post({"at": "finished-2-0", "choice": "comment", "comment": "not asked"})
        assert stored_comment(who) is None


def test_a_withdrawal_takes_the_comment_along(taking: Callable[..., Taking]) -> None:
    who = finish(taking(flow=(), comments=True))
    who.send(choice="comment", comment="I am Wilhelmina")
    who.store.withdraw(CODE)
    shown = who.page()
    assert "You have left the study" in shown
    assert "Your comment is stored" not in shown
    assert "<h2>What this study is about</h2>" in shown
    assert stored_comment(who) is None


def test_leaving_asks_once_more_and_is_for_good(taking: Callable[..., Taking]) -> None:
    who = taking(end=EndCode())
    assert "Leave the study" in who.page()
    asked = who.client.get(f"{who.address}leave").text
    assert "will be deleted" in asked
    assert who.stages() == ["arrived"]
    who.post({"choice": "withdraw"})
    assert who.stages()[-1] == "withdrawn"
    assert "has been deleted" in who.page()
    assert "code" not in who.page().lower().replace('<meta charset="utf-8">', "")
    who.post({"choice": "withdraw"})
    assert who.stages().count("withdrawn") == 1


def test_a_full_disk_says_so_and_loses_nothing(taking: Callable[..., Taking], monkeypatch: pytest.MonkeyPatch) -> None:
    who = taking(flow=("consent",))
    at = re.findall(r'name="at" value="([^"]*)"', who.page())[0]

    def full(*_: object, **__: object) -> None:
        raise StoreFullError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(who.store, "give_consent", full)
        reply = who.post({"at": at, "choice": "agree"})
        assert reply.status_code == 503
        assert "The study is paused" in reply.text
    who.post({"at": at, "choice": "agree"})
    assert who.stages() == ["arrived", "consented"]


def test_a_person_who_dropped_out_goes_on_at_the_same_place(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",))
    enter(who, "arrived", "dropped_out")
    assert who.place() == "consent"
    assert who.stages() == ["arrived", "dropped_out", "returned"]


def test_the_only_page_of_a_quick_study_names_the_kind_of_home(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("instructions",))
    shown = who.page()
    assert "This home: invented home." in shown
    assert 'class="steps"' not in shown
    assert CANARY not in shown
    who.send(choice="read")
    assert who.page() == ""


def test_the_parts_of_the_study_stand_above_each_page(taking: Callable[..., Taking]) -> None:
    shown = " ".join(taking().page().split())
    parts = re.findall(r"<li(?: class=\"\w+\")?(?: aria-current=\"step\")?>([A-Z]\w+)</li>", shown)
    assert parts == ["Check", "Consent", "Instructions", "Questions", "Study", "End"]
    assert '<li class="now" aria-current="step">Check</li>' in shown


def through_the_client(who: Taking, monkeypatch: pytest.MonkeyPatch) -> Session:
    """A bot's session that asks the participant's client instead of a network."""

    def ask(origin: str, path: str, *, cookie: str, body: str | None) -> Reply:
        headers = {"origin": origin, "content-type": "application/x-www-form-urlencoded"}
        method = "GET" if body is None else "POST"
        reply = who.client.request(method, path, content=body, headers=headers, follow_redirects=False)
        return Reply(reply.status_code, reply.headers.get("location", ""), reply.text, "")

    monkeypatch.setattr("personal_viz.bots.forms.ask", ask)
    return Session(ORIGIN, "", who.address, "")


def test_a_bot_answers_all_pages_and_stops_at_the_last(
    taking: Callable[..., Taking], monkeypatch: pytest.MonkeyPatch
) -> None:
    who = taking()
    session = through_the_client(who, monkeypatch)
    assert answer_pages(session, right_answers(who.store.config)) is None
    assert who.stages() == ["arrived", "device_ok", "consented", "instructed", "quiz_passed"]
    for _ in range(3):
        do_next(who.store, CODE)
    assert answer_pages(session) == LastPage("finished", "ABCD1234")


def test_a_bot_confirms_the_points_and_answers_the_survey(
    taking: Callable[..., Taking], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    who = taking(flow=("consent",), survey={"eligibility": ("I read English.",), "questions": tuple(SURVEY)})
    session = through_the_client(who, monkeypatch)
    assert answer_pages(session) is None
    assert who.stages() == ["arrived", "consented"]
    while do_next(who.store, CODE) is not None:
        pass
    assert answer_pages(session) == LastPage("finished", "ABCD1234")
    export_study(who.store.folder, tmp_path / "out")
    rows = read_survey(tmp_path / "out")
    assert [(row.topic, row.answer) for row in rows] == [(topic, "prefer_not_to_say") for topic in SURVEY]


ASKED = {"questions": ("homes", "age")}


def at_the_survey(taking: Callable[..., Taking], survey: dict[str, Any] = ASKED) -> Taking:
    """Somebody who has done all searches of a study with a survey."""
    who = taking(flow=("consent",), survey=survey)
    who.page()
    who.send(choice="agree")
    while do_next(who.store, CODE) is not None:
        pass
    return who


def test_the_survey_is_asked_before_the_code_and_its_answers_are_encrypted(taking: Callable[..., Taking]) -> None:
    who = at_the_survey(taking)
    page = who.page()
    assert who.place() == "survey"
    assert "ABCD1234" not in page
    assert page.index("How old are you?") < page.index("Had you seen any of these homes")
    assert page.count("I prefer not to say") == 2
    assert "checked" not in page
    assert "gender" not in page
    who.send(choice="send", age="25_34", homes="prefer_not_to_say")
    assert who.place() == "finished"
    assert "ABCD1234" in who.page()
    assert who.stages()[-3:] == ["survey_begun", "survey_ended", "finished"]
    assert all(entry.detail == {} for entry in who.store.participant(CODE).stages[-3:])
    with read_study(who.store.folder) as reader:
        assert reader.answers("survey") == {CODE: '{"age": "25_34", "homes": "prefer_not_to_say"}'}
        (stored,) = reader.rows("SELECT payload FROM personal_answer")
    assert "25_34" not in stored[0]


@pytest.mark.parametrize("fields", [{"choice": "skip", "age": "25_34"}, {"choice": "send"}])
def test_a_survey_may_be_skipped_and_left_empty(taking: Callable[..., Taking], fields: dict[str, str]) -> None:
    who = at_the_survey(taking)
    who.page()
    who.send(**fields)
    assert who.place() == "finished"
    with read_study(who.store.folder) as reader:
        assert set(reader.answers("survey").values()) <= {"{}"}


def test_a_survey_stores_known_answers_to_its_own_questions_only(taking: Callable[..., Taking]) -> None:
    who = at_the_survey(taking)
    who.page()
    who.send(choice="send", age="=cmd()", gender="woman", homes="yes", note="<script>")
    with read_study(who.store.folder) as reader:
        assert reader.answers("survey") == {CODE: '{"homes": "yes"}'}


def test_somebody_at_the_survey_may_still_withdraw(taking: Callable[..., Taking]) -> None:
    who = at_the_survey(taking)
    assert "Leave the study" in who.page()
    who.send(choice="withdraw")
    assert who.place() == "withdrawn"


def test_without_a_survey_nobody_is_asked(taking: Callable[..., Taking]) -> None:
    who = at_the_survey(taking, {})
    assert who.place() == "finished"
    assert "survey_begun" not in who.stages()


def test_each_point_of_eligibility_is_confirmed_before_consent(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",), survey={"eligibility": ("I have not seen these homes.", "I <b>read</b> English.")})
    page = who.page()
    assert "I have not seen these homes." in page
    assert "<b>read" not in who.client.get(who.address).text
    assert page.count("required") == 2
    who.send(choice="agree", eligible_0="yes")
    assert who.place() == "consent"
    assert who.store.participant(CODE).consent is None
    who.send(choice="agree", eligible_0="yes", eligible_1="yes")
    assert who.stages() == ["arrived", "consented"]


def test_who_cannot_confirm_a_point_takes_no_part(taking: Callable[..., Taking]) -> None:
    who = taking(flow=("consent",), survey={"eligibility": ("I have not seen these homes.",)})
    who.page()
    who.send(choice="not_eligible")
    assert who.place() == "screened_out"
    assert "another kind of computer" not in who.page()
    assert "needs people who can confirm each point" in who.page()
    assert who.last_detail() == {"not_eligible": True}
    assert who.store.participant(CODE).consent is None
    assert all(trial.is_released for trial in trials_of(who.store, CODE))
