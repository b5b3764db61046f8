"""Leads a participant through the pages around the trials; each answer is stored before the next page is shown."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from human_study.design.study import Condition, StudyConfig
from human_study.journey import (
    QUIZ_ROUNDS,
    AssignedTrial,
    Journey,
    Person,
    Place,
    ended_trial,
    has_rested,
    journey_of,
    trial_before,
    trial_name,
)
from human_study.store.stages import last_detail
from human_study.texts.participants import CONSENT_FILE, INSTRUCTIONS_FILE, instruction_texts, told_text, welcome_text
from human_study.texts.quiz import Question, QuizRound, questions_for

from ..page_script import Device
from ..store_link import PersonPlace, StoreLink
from .cards import (
    IN_3D,
    DeviceReport,
    break_card,
    consent_card,
    device_card,
    end_card,
    instruction_card,
    interrupted_card,
    pause_card,
    practice_card,
    question_card,
    real_card,
    saved_card,
)
from .desk import Chosen, Desk
from .markdown import html_from_markdown, title_of
from .panels import Card, Choice, paragraphs
from .pauses import machine_time, pause_left_s, steady_detail
from .place import PARTS, parts_of


@dataclass(slots=True)
class QuizMemory:
    """Rounds of the quiz that are under way in this worker, by participant: a reload does not begin a new one."""

    rounds: dict[str, QuizRound] = field(default_factory=dict)


class FlowPages:
    """The pages of one participant at one connection."""

    def __init__(
        self,
        desk: Desk,
        link: StoreLink,
        config: StudyConfig,
        *,
        texts: Mapping[str, str],
        quizzes: QuizMemory,
        label_of_home: Callable[[str], str],
    ) -> None:
        """Shows nothing yet.

        Args:
            desk: The participant's page and queue.
            link: To the store.
            config: The study.
            texts: Of the study, by file name (`told_text`).
            quizzes: Of the worker.
            label_of_home: What participants are told of a home, from its scene's name.
        """
        self._desk, self._link, self._config = desk, link, config
        self._texts, self._quizzes, self._label_of_home = texts, quizzes, label_of_home

    def lead(self) -> Person:
        """Shows page after page until the participant has a trial to do, or nothing more; returns where that is.

        Raises: as `Desk.wait`.
        """
        while True:
            person = self._person()
            journey = self.journey(person)
            step = {
                "dropped_out": self._return,
                "device": self._device,
                "consent": self._consent,
                "instructions": self._instructions,
                "quiz": self._quiz,
                "break": self._break,
                "pause": self._pause,
            }.get(journey.place)
            if step is None:
                return person
            step(person, journey)

    def journey(self, person: Person) -> Journey:
        """Where the participant is now."""
        return journey_of(self._config, person)

    def welcome_back(self) -> None:
        """Says which trial is stored to somebody who left or reloaded the page between two; nothing to others."""
        person = self._person()
        journey, before = self.journey(person), trial_before(person)
        if journey.place in ("practice", "trial") and before is not None and not has_rested(person, journey):
            self._desk.choose(saved_card(journey, trial_name(person, before)))

    def after(self, played: AssignedTrial, *, word: str = "") -> None:
        """Says what the store has of the trial that was open, before the next one; nothing where a break comes.

        Args:
            played: The trial.
            word: What is said of one that was practice.
        """
        person = self._person()
        journey = self.journey(person)
        if journey.place not in ("practice", "trial"):
            return
        ended = ended_trial(person, played.order_no)
        if ended is None:
            self._desk.choose(interrupted_card(journey))
        else:
            self._desk.choose(saved_card(journey, trial_name(person, ended), word))

    def introduce(self, person: Person, journey: Journey) -> None:
        """Says before the first practice trial, and before the first counted one after practice, what follows."""
        practice = [trial for trial in person.kept if trial.phase == "practice"]
        if journey.place == "practice" and not any(trial.is_begun for trial in practice):
            self._choose(practice_card(len(practice)), person, "practice")
        others = [trial for trial in person.kept if trial.phase != "practice"]
        if journey.place == "trial" and practice and not any(trial.is_begun for trial in others):
            self._choose(real_card(journey), person, "trial")

    def end(self, stored: PersonPlace) -> None:
        """The last page, with the code that belongs to it."""
        journey = self.journey(stored.person)
        card = end_card(self._config, journey, code=stored.completion_code, url=stored.end_url)
        self._desk.show(self._on_its_way(card, stored.person, journey.place))

    def _person(self) -> Person:
        return self._link.person(self._desk.code).person

    def _return(self, person: Person, _: Journey) -> None:
        """Whoever comes back goes on where the way was left, with what others did not take."""
        self._link.enter_stage(person.code, "returned")

    def _device(self, person: Person, _: Journey) -> None:
        """Waits until graphics, window and keyboard are there; each new kind of failure is stored once."""
        needs_webgl = any(trial.condition in IN_3D for trial in person.kept)
        has_keys = person.task == "pan"
        has_pressed, uses_buttons = False, not has_keys
        failed: set[tuple] = set()
        shown: Card | None = None
        while True:
            report = None
            if self._desk.device is not None:
                report = DeviceReport(self._desk.device, needs_webgl, has_pressed, uses_buttons)
                if not report.can_show and (found := tuple(report.detail().items())) not in failed:
                    failed.add(found)
                    self._link.enter_stage(self._desk.code, "device_failed", report.detail())
            card = device_card(report, has_keys=has_keys, may_leave=self._config.recruit.kind == "prolific")
            card = self._on_its_way(card, person, "device")
            if card != shown:
                self._desk.show(card, hears=(Device,), hotkeys=("W",))
                shown = card
            said = self._desk.wait().content
            if isinstance(said, Device):
                continue
            assert isinstance(said, Chosen), said
            match said.name:
                case "W":
                    has_pressed = True
                case "reload":
                    self._desk.reload()
                case "leave":
                    self._link.enter_stage(self._desk.code, "screened_out")
                    return
                case "buttons" | "continue" if report is not None and report.can_show:
                    detail = {**report.detail(), "buttons": not has_pressed}
                    self._link.enter_stage(self._desk.code, "device_ok", detail)
                    return

    def _consent(self, person: Person, _: Journey) -> None:
        text = told_text(self._texts, CONSENT_FILE, person.task)
        answer = self._choose(consent_card(text), person, "consent")
        self._link.give_consent(self._desk.code, text, given=answer == "agree")

    def _instructions(self, person: Person, journey: Journey) -> None:
        conditions: list[Condition] = [trial.condition for trial in person.kept]
        if self._config.flow == ("instructions",):
            self._welcome(person)
        else:
            own = told_text(self._texts, INSTRUCTIONS_FILE, person.task)
            pages = (*([own] if own.strip() else []), *instruction_texts(self._config, person.task, conditions))
            index = 0
            while index < len(pages):
                card = instruction_card(pages, index, is_again=journey.failed_rounds > 0)
                index += -1 if self._choose(card, person, "instructions") == "back" else 1
        self._link.enter_stage(self._desk.code, "instructed", {"after_failed_rounds": journey.failed_rounds})

    def _welcome(self, person: Person) -> None:
        """The only page of a study that has no other before its trials."""
        text = welcome_text(self._config, person.task)
        body = html_from_markdown(text)
        if person.kept:
            body += paragraphs(f"This home: {self._label_of_home(person.kept[0].key.scene)}.")
        self._choose(
            Card(title_of(text, otherwise="Welcome"), body, (Choice("next", "Start"),)), person, "instructions"
        )

    def _quiz(self, person: Person, journey: Journey) -> None:
        """One round through the questions, in the second only those that were answered wrongly."""
        code = self._desk.code
        questions = questions_for(self._config, person.task, [trial.condition for trial in person.kept])
        if journey.failed_rounds:
            missed = last_detail(person.stages, "quiz_failed").get("wrong", [])
            questions = tuple(question for question in questions if question.name in missed) or questions
        quiz = self._quizzes.rounds.setdefault(code, QuizRound(questions))
        was_wrong = False
        while (question := quiz.present) is not None:
            card = self._question_card(quiz, question, was_wrong=was_wrong)
            was_wrong = not quiz.answer(self._choose(card, person, "quiz"))
        del self._quizzes.rounds[code]
        detail = {"round": 1 + journey.failed_rounds, "wrong": quiz.wrong}
        self._link.enter_stage(code, "quiz_failed" if quiz.wrong else "quiz_passed", detail)
        if quiz.wrong:
            is_last = journey.failed_rounds + 1 >= QUIZ_ROUNDS
            again = "Please read the instructions once more." if is_last else "They are asked once more."
            card = Card(
                "Almost", paragraphs(f"Some questions were not right at once. {again}"), (Choice("next", "Continue"),)
            )
            self._choose(card, person, "quiz")

    def _question_card(self, quiz: QuizRound, question: Question, *, was_wrong: bool) -> Card:
        seed = [*self._desk.code.encode(), *question.name.encode()]
        return question_card(
            question,
            question.shuffled(seed),
            number=quiz.answered + 1,
            num_all=len(quiz.questions),
            was_wrong=was_wrong,
        )

    def _break(self, person: Person, journey: Journey) -> None:
        if journey.rest is None:
            self._link.enter_stage(self._desk.code, "break_started", {"done": journey.num_done})
        self._choose(break_card(journey), person, "trial")
        self._link.enter_stage(self._desk.code, "break_ended", {"done": journey.num_done})

    def _pause(self, person: Person, journey: Journey) -> None:
        gap_s, now = self._config.breaks.sitting_gap_s, machine_time()
        if journey.rest is None:
            detail = {"done": journey.num_done, "sitting": True, **steady_detail(now)}
            self._link.enter_stage(self._desk.code, "break_started", detail)
        back_in_s = gap_s if journey.rest is None else pause_left_s(journey.rest, gap_s, now)
        card = pause_card(self._config, journey, back_in_s=back_in_s)
        if self._choose(card, person, "trial") == "next":
            self._link.enter_stage(self._desk.code, "sitting_started", {"done": journey.num_done})

    def _choose(self, card: Card, person: Person, step: Place) -> str:
        return self._desk.choose(self._on_its_way(card, person, step))

    def _on_its_way(self, card: Card, person: Person, step: Place) -> Card:
        """The card with the parts of the way above it."""
        parts = parts_of(self._config, person)
        if step not in PARTS or PARTS[step] not in parts:
            return card
        return Card(card.title, card.body, card.choices, parts, parts.index(PARTS[step]))
