"""The pages of a study without 3-D, as HTML forms: each answer is stored before the next page is shown.

`journey.py` says where a participant is. A page is made anew from the stored records whenever a browser asks, and a
form names the state that it answers, so that a reload or a second press answers nothing twice.
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from human_study.design.study import Condition, StudyConfig
from human_study.journey import Journey, Person, Stage, has_reached, journey_of, last_detail
from human_study.store.people import MAX_ANSWER
from human_study.store.store import StudyStore
from human_study.texts.catalogue import Catalogue, catalogue_of
from human_study.texts.participants import (
    CONSENT_FILE,
    DEBRIEFING_FILE,
    INSTRUCTIONS_FILE,
    instruction_texts,
    leave_text,
    parts_of,
    told_text,
    welcome_text,
)
from human_study.texts.quiz import Question, QuizRound, questions_for
from human_study.texts.survey import answers_to_json, given_answers, questions_of

from ..markdown import html_from_markdown, title_of
from ..recruit_codes import EndCode
from .device import MIN_HEIGHT, MIN_WIDTH, SMALLER, device_report, needs_webgl
from .pauses import machine_time, pause_left_s, steady_detail

TEMPLATES = Path(__file__).parents[1] / "templates"
MAX_FORM_BYTES = 32 * 1024
"""Largest form: a comment takes 12 bytes per character at most."""
_TEMPLATE_OF = {"declined": "end", "withdrawn": "end", "screened_out": "end", "full": "end", "finished": "end"}


class Pages:
    """The pages of all participants of a study; any thread may call it."""

    def __init__(
        self,
        store: StudyStore,
        *,
        texts: Mapping[str, str],
        client_profile: Callable[[str], dict[str, Any] | None] = lambda _: None,
        end_code: Callable[[str, Stage], EndCode] = lambda *_: EndCode(),
        warm: Callable[[str, str], None] = lambda *_: None,
    ) -> None:
        """Shows nothing yet.

        Args:
            store: The study's store.
            texts: Texts of the study, by file name (`told_text`).
            client_profile: Returns the coarse profile of a participant's browser, which is stored with each sitting;
                None = not known.
            end_code: Returns the code for a participant who ended by this stage.
            warm: Called with (participant, scene) for the home that comes next, so that it is open by then.
        """
        self._store, self._texts = store, texts
        self._client_profile, self._end_code, self._warm = client_profile, end_code, warm
        self._quizzes: dict[str, QuizRound] = {}
        """Unfinished rounds of the quiz by participant, so that a reload does not begin a new one."""
        self._locks: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self.words = catalogue_of(store.config.language)
        """Short texts in the study's language."""
        self._templates = _environment(self.words)

    @property
    def _config(self) -> StudyConfig:
        return self._store.config

    def shown(self, code: str, base: str, *, page: int = 1) -> str | None:
        """The participant's page as HTML; None where the next thing is 3-D.

        Args:
            code: The participant.
            base: Address of the participant's pages, to which forms are sent.
            page: Number of the page of instructions, from 1.

        Raises:
            StudyError: The store cannot be written; nothing is lost.
        """
        with self._locks[code]:
            person, journey = self._next(code)
            if person.due is not None:
                self._warm(code, person.due.key.scene)
            if journey.place in ("practice", "trial"):
                return None
            return self._page(person, journey, base, max(1, page))

    def leaving(self, code: str, base: str) -> str | None:
        """The page that asks somebody who wants to leave to confirm it; None where there is nothing to leave."""
        with self._locks[code]:
            person, journey = self._next(code)
            if not _may_leave(journey):
                return None
            return self._html("leave", person, journey, base, on_leave=leave_text(self._config))

    def message(self, name: str) -> str:
        """A page that belongs to no place in the study: `enter`, `paused`."""
        least = {"width": round(SMALLER * MIN_WIDTH), "height": round(SMALLER * MIN_HEIGHT)}
        template = self._templates.get_template(f"{name}.html")
        return template.render(parts=(), part=0, base="", place="", may_leave=False, **least)

    def answer(self, code: str, form: Mapping[str, str]) -> None:
        """Stores the answer of a form; does nothing where the form answers another state than the present one.

        Raises:
            StudyError: The store cannot be written; nothing is lost.
        """
        with self._locks[code]:
            person, journey = self._next(code)
            if form.get("choice") == "withdraw":
                if _may_leave(journey):
                    self._store.withdraw(code)
            elif form.get("at") == self._at(person, journey):
                self._store_answer(person, journey, form)
            self._next(code)

    def _next(self, code: str) -> tuple[Person, Journey]:
        """The participant's person and journey, after stages that need no answer are stored."""
        while True:
            person = self._store.participant(code)
            journey = journey_of(self._config, person)
            done = {"done": journey.num_done}
            if not person.stages:
                self._store.enter_stage(code, "arrived")
            elif journey.place == "dropped_out":
                self._store.enter_stage(code, "returned")  # goes on at the same place, with the trials that others left
            elif journey.place == "ending":
                if self._store.next_trial(code) is None:
                    has_done = any(trial.phase == "main" for trial in person.kept)
                    is_asked = (
                        has_done and self._config.survey.questions and not has_reached(person.stages, "survey_ended")
                    )
                    self._store.enter_stage(code, "survey_begun" if is_asked else "finished" if has_done else "full")
            elif journey.place == "quiz" and (quiz := self._quizzes.get(code)) is not None and quiz.present is None:
                detail = {"round": 1 + journey.failed_rounds, "wrong": quiz.wrong}
                self._store.enter_stage(code, "quiz_failed" if quiz.wrong else "quiz_passed", detail)
                del self._quizzes[code]
            elif journey.place == "break" and journey.rest is None:
                self._store.enter_stage(code, "break_started", done)
            elif journey.place == "pause" and journey.rest is None:
                self._store.enter_stage(
                    code, "break_started", {**done, "sitting": True, **steady_detail(machine_time())}
                )
            else:
                return person, journey

    def _page(self, person: Person, journey: Journey, base: str, page: int) -> str:
        match journey.place:
            case "device":
                words: dict[str, Any] = {
                    "needs_webgl": needs_webgl(self._config, person),
                    "width": MIN_WIDTH,
                    "height": MIN_HEIGHT,
                    "smaller": SMALLER,
                }
            case "consent":
                words = _text_words(told_text(self._texts, CONSENT_FILE, person.task), self.words("consent.title"))
                words["eligibility"] = self._config.survey.eligibility
            case "instructions":
                words = self._instructions(person, page)
            case "quiz":
                words = self._question(person, journey)
            case "pause":
                left_s = self._left_s(journey)
                words = {"back_in": self.words.waiting_time(left_s) if left_s > 0 else None}
            case "survey":
                words = {"questions": questions_of(self._config)}
            case "finished" | "declined" | "withdrawn" | "screened_out" | "full":
                words = self._end(person, journey.place)
                words["is_eligible"] = not last_detail(person.stages, "screened_out").get("not_eligible")
            case _:
                words = {}
        return self._html(_TEMPLATE_OF.get(journey.place, journey.place), person, journey, base, **words)

    def _html(self, name: str, person: Person, journey: Journey, base: str, **words: Any) -> str:
        parts = parts_of(self._config, person)
        own = "trial" if journey.place in ("break", "pause") else journey.place
        part = parts.index(own) if own in parts else None
        return self._templates.get_template(f"{name}.html").render(
            parts=() if part is None else parts,
            part=part,
            base=base,
            place=journey.place,
            at=self._at(person, journey),
            config=self._config,
            person=person,
            journey=journey,
            may_leave=_may_leave(journey) and name != "leave",
            **words,
        )

    def _at(self, person: Person, journey: Journey) -> str:
        """Name of the state that a form answers; each stored answer leads to a different state."""
        quiz = self._quizzes.get(person.code) if journey.place == "quiz" else None
        passed = sum(entry.stage not in ("device_failed", "keys_changed") for entry in person.stages)
        return f"{journey.place}-{passed}-{quiz.answered if quiz is not None else 0}"

    def _instructions(self, person: Person, page: int) -> dict[str, Any]:
        if self._config.flow == ("instructions",):
            words = _text_words(welcome_text(self._config, person.task), self.words("instructions.welcome"))
            scene = self._store.plan.scene(person.kept[0].key.scene) if person.kept else None
            home = self.words(f"home.{scene.kind}") if scene is not None else None
            return {**words, "page": 1, "num_pages": 1, "home": home, "is_only": True}
        own = told_text(self._texts, INSTRUCTIONS_FILE, person.task)
        conditions: list[Condition] = [trial.condition for trial in person.kept]
        pages = (*([own] if own.strip() else []), *instruction_texts(self._config, person.task, conditions))
        page = min(page, len(pages))
        words = _text_words(pages[page - 1], self.words("instructions.title"))
        return {**words, "page": page, "num_pages": len(pages), "home": None, "is_only": False}

    def _quiz(self, person: Person, journey: Journey) -> QuizRound:
        """The unfinished round, or a new one; the second round asks only questions answered wrongly in the first."""
        if person.code not in self._quizzes:
            questions = questions_for(self._config, person.task, [trial.condition for trial in person.kept])
            if journey.failed_rounds:
                missed = last_detail(person.stages, "quiz_failed").get("wrong", [])
                questions = tuple(question for question in questions if question.name in missed) or questions
            self._quizzes[person.code] = QuizRound(questions)
        return self._quizzes[person.code]

    def _question(self, person: Person, journey: Journey) -> dict[str, Any]:
        quiz = self._quiz(person, journey)
        question = quiz.present
        assert question is not None
        return {
            "question": question,
            "answers": _shuffled(person, question),
            "number": quiz.answered + 1,
            "num_all": len(quiz.questions),
            "because": _html_of(self.words("quiz.wrong", because=question.because))
            if question.name in quiz.wrong
            else None,
        }

    def _end(self, person: Person, place: Stage) -> dict[str, Any]:
        """The last page's code, what the study is about, and whether a comment may still be written."""
        text = told_text(self._texts, DEBRIEFING_FILE, person.task)
        debriefing = (
            _text_words(text, self.words("end.debriefing_title")) if place in ("finished", "withdrawn") else None
        )
        if debriefing is not None and not text.strip():
            debriefing["text"] = _html_of(self.words("end.debriefing"))
        asks = self._config.comments and place == "finished"
        has_commented = asks and self._store.has_answered(person.code, "comment")
        return {
            "end": self._end_code(person.code, place),
            "debriefing": debriefing,
            "has_commented": has_commented,
            "may_comment": asks and not has_commented,
            "max_comment": MAX_ANSWER,
        }

    def _left_s(self, journey: Journey) -> float:
        """Seconds that a pause still lasts."""
        assert journey.rest is not None
        return pause_left_s(journey.rest, self._config.breaks.sitting_gap_s, machine_time())

    def _store_answer(self, person: Person, journey: Journey, form: Mapping[str, str]) -> None:
        code, choice, done = person.code, form.get("choice", ""), {"done": journey.num_done}
        match journey.place, choice:
            case "device", _:
                self._store_device(person, form)
            case "consent", "agree" if not all(
                form.get(f"eligible_{number}") for number, _ in enumerate(self._config.survey.eligibility)
            ):
                return  # a browser that does not require the boxes; the page is shown again
            case "consent", "not_eligible" if self._config.survey.eligibility:
                self._store.enter_stage(code, "screened_out", {"not_eligible": True})
            case "consent", "agree" | "decline":
                text = told_text(self._texts, CONSENT_FILE, person.task)
                self._store.give_consent(code, text, given=choice == "agree")
            case "instructions", "read":
                self._quizzes.pop(code, None)
                self._store.enter_stage(code, "instructed", {"after_failed_rounds": journey.failed_rounds})
            case "quiz", _:
                self._store_quiz(person, journey, form.get("answer", ""))
            case "survey", "send" | "skip":
                if choice == "send":
                    self._store.keep_answer(code, "survey", answers_to_json(given_answers(self._config, form)))
                self._store.enter_stage(code, "survey_ended")
            case "finished", "comment" if self._config.comments and (comment := _tidy(form.get("comment", ""))):
                if not self._store.has_answered(code, "comment"):
                    self._store.keep_answer(code, "comment", comment)
            case "break", "next":
                self._store.enter_stage(code, "break_ended", done)
            case "pause", "next" if self._left_s(journey) <= 0:
                profile = self._client_profile(code)
                self._store.enter_stage(code, "sitting_started", {**done, "client": profile} if profile else done)

    def _store_device(self, person: Person, form: Mapping[str, str]) -> None:
        """Stores each new kind of failure once; a participant whose device is good enough goes on."""
        code, report = person.code, device_report(form)
        if form.get("choice") == "leave" and self._config.recruit.kind == "prolific":
            self._store.enter_stage(code, "screened_out")
        elif report is None:
            return
        elif not report.can_show(needs_webgl=needs_webgl(self._config, person)):
            known = [entry.detail for entry in person.stages if entry.stage == "device_failed"]
            if report.detail() not in known:
                self._store.enter_stage(code, "device_failed", report.detail())
        elif form.get("choice") in ("continue", "buttons"):
            detail = {**report.detail(), "buttons": not report.has_pressed}
            self._store.enter_stage(code, "device_ok", detail)

    def _store_quiz(self, person: Person, journey: Journey, answer: str) -> None:
        quiz = self._quiz(person, journey)
        question = quiz.present
        assert question is not None
        if answer in question.answers:
            quiz.answer(answer)


def _environment(words: Catalogue) -> jinja2.Environment:
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.globals["words"] = words
    return found


def _may_leave(journey: Journey) -> bool:
    """Whether the participant has anything to withdraw from."""
    return journey.place not in ("finished", "declined", "withdrawn", "screened_out", "full")


def _shuffled(person: Person, question: Question) -> tuple[str, ...]:
    """The answers in this participant's order."""
    return question.shuffled([*person.code.encode(), *question.name.encode()])


def _tidy(comment: str) -> str:
    """A comment without control characters and with plain ends of lines, cut at its largest length; '' = none."""
    lines = comment.replace("\r\n", "\n")[:MAX_ANSWER].splitlines()
    return "\n".join("".join(letter if letter.isprintable() else " " for letter in line) for line in lines).strip()


def _text_words(text: str, otherwise: str) -> dict[str, Any]:
    """Title and body of a text that begins with its heading."""
    return {"title": title_of(text, otherwise=otherwise), "text": _html_of(text)}


def _html_of(text: str) -> Markup:
    return Markup(html_from_markdown(text))
