"""The texts that one participant reads: consent, instructions, feedback on practice. Markdown, shown by the pages.

A study's own `consent.md`, `instructions.md` and, if there is one, `debriefing.md` are filled in when the study is
planned and frozen with it; the program's own pages on task, keys and rules follow the instructions and need no file.
"""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

from sim.errors import StudyError
from sim.sequences.runs import SequenceRun
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import TaskKind

from ..design.plan import StudyPlan
from ..design.study import Condition, Language, StudyConfig, write_whole
from ..journey import AssignedTrial, Person
from .catalogue import catalogue_of
from .contradictions import disagreements, unsaid
from .words import filled, filled_text, open_places, source_of, words_of

CONSENT_FILE = "consent.md"
INSTRUCTIONS_FILE = "instructions.md"
TEXT_FILES = (CONSENT_FILE, INSTRUCTIONS_FILE)
"""Texts of a study's folder that a researcher may change before the plan."""
DEBRIEFING_FILE = "debriefing.md"
"""Text of a study's folder that a researcher may add before the plan: what people read at the end."""
TOLD_FOLDER = "told"
"""Folder in a study's folder with the texts exactly as participants of each task read them."""


def write_texts(folder: Path, language: Language) -> None:
    """Writes the texts that a study begins with, in this language, except those that the researcher has written.

    A text that was written for another language, and that nobody has changed, is written anew.

    Raises:
        StudyError: The folder cannot be written.
    """
    for name in TEXT_FILES:
        path, others = folder / name, set(get_args(Language)) - {language}
        found = path.read_text(encoding="utf-8") if path.exists() else None
        if found is None or found in (source_of(name, other) for other in others):
            write_whole(path, source_of(name, language))


def freeze_texts(folder: Path, config: StudyConfig, plan: StudyPlan) -> dict[str, str]:
    """Fills in the study's texts for the participants of each task.

    Returns:
        The sha256 of all files by name, and of the program's own texts by the name of their language.

    Raises:
        StudyError: A text for people has a place that is not filled in, or contradicts the study file.
    """
    write_texts(folder, config.language)
    told, problems = {}, list[str]()
    if config.comments and "consent" not in config.flow:
        problems.append(f"comments only with consent in flow, found flow {list(config.flow)}")
    sources = (*TEXT_FILES, *([DEBRIEFING_FILE] if (folder / DEBRIEFING_FILE).exists() else []))
    for name in sources:
        source = (folder / name).read_text(encoding="utf-8")
        for task in config.task:
            words = words_of(config, plan=plan, task=task, is_for_people=True)
            text = filled_text(source, words, where=folder / name)
            told[told_name(name, task)] = text
            is_shown = config.flow != ("instructions",) and name.removesuffix(".md") in config.flow
            if is_shown or name == DEBRIEFING_FILE:
                found = _problems(text, config, plan, task) + (unsaid(text, config) if name == CONSENT_FILE else [])
                problems += [f"{name}: {problem}" for problem in found]
    if problems:
        raise StudyError(
            f"{folder}: texts for participants do not fit study.yaml: {'; '.join(dict.fromkeys(problems))}. Expected "
            "what study.yaml says and nothing to be filled in. Correct study.yaml or the text, then plan again."
        )
    for name, text in told.items():
        write_whole(folder / name, text)
    frozen = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (*sources, *told)}
    language = catalogue_of(config.language)
    return {**frozen, language.name: language.digest()}


def has_other_words(config: StudyConfig, plan: StudyPlan) -> bool:
    """Whether the program's own texts differ from those of the plan; plans of earlier versions do not know theirs."""
    language = catalogue_of(config.language)
    return plan.texts.get(language.name, language.digest()) != language.digest()


def told_name(name: str, task: TaskKind) -> str:
    """Path, within the study's folder, of a text as the participants of a task read it."""
    return f"{TOLD_FOLDER}/{name.removesuffix('.md')}-{task}.md"


def told_texts(folder: Path, plan: StudyPlan) -> dict[str, str]:
    """All existing texts of a planned study, by file name."""
    names = plan.texts or TEXT_FILES
    return {name: path.read_text("utf-8") for name in names if (path := folder / name).is_file()}


def told_text(texts: Mapping[str, str], name: str, task: TaskKind) -> str:
    """A frozen text for a task; studies planned by an earlier version have one for all tasks. '' = there is none."""
    return texts.get(told_name(name, task), texts.get(name, ""))


def instruction_texts(config: StudyConfig, task: TaskKind, conditions: Sequence[Condition]) -> tuple[str, ...]:
    """The program's own pages on task, keys and rules for all these conditions; each begins with its heading."""
    text = filled("pages.md", words_of(config, task=task, conditions=conditions))
    return tuple(f"# {page}" for page in f"\n{text}".split("\n# ")[1:])


def welcome_text(config: StudyConfig, task: TaskKind) -> str:
    """The whole instructions where a study has no other page before its trials."""
    return filled("welcome.md", words_of(config, task=task))


def leave_text(config: StudyConfig) -> str:
    """The text that tells people, before they withdraw, what will happen to their data."""
    return words_of(config)["on_leave"]


def practice_text(config: StudyConfig, task: TaskKind, result: EpisodeRun | Answer | SequenceRun | None) -> str:
    """Feedback on a practice trial by the study's rule; people get no feedback on other trials."""
    if isinstance(result, SequenceRun):
        found = [search.succeeds(config.success) is True for search in result.end.searches]
        counts = {"num_right": sum(found), "num_searches": len(found), "is_right": all(found)}
        return filled("practice.md", words_of(config, task=task) | counts)
    is_right = None
    if isinstance(result, EpisodeRun) and result.end.measures is not None:
        rule = result.end.measures.rules.get(config.success)
        is_right = rule.success if rule is not None else None
    elif isinstance(result, Answer) and result.measures is not None:
        is_right = result.measures.success
    if is_right is None:
        return catalogue_of(config.language)("practice.unscored")
    return filled("practice.md", words_of(config, task=task) | {"is_right": is_right})


def parts_of(config: StudyConfig, person: Person) -> tuple[str, ...]:
    """The parts that this participant passes, by the places where they begin; () where only one page comes before the
    trials. Their names are the words `part.<place>`.
    """
    if config.flow == ("instructions",):
        return ()
    has_practice = any(trial.phase == "practice" for trial in person.trials)
    asked = ("survey",) if config.survey.questions else ()
    return (*config.flow, *(["practice"] if has_practice else []), "trial", *asked, "finished")


def trial_name(config: StudyConfig, person: Person, trial: AssignedTrial) -> str:
    """The trial's name for participants, with its number within its phase; attention trials look like any other."""
    is_practice = trial.phase == "practice"
    alike = [other for other in person.kept if (other.phase == "practice") == is_practice]
    number = 1 + sum(other.order_no < trial.order_no for other in alike)
    key = "trial.practice" if is_practice else "trial.search" if config.sequences is None else "homes.number"
    return catalogue_of(config.language)(key, number=number, all=len(alike))


def _problems(text: str, config: StudyConfig, plan: StudyPlan, task: TaskKind) -> list[str]:
    """The reasons why a text cannot be shown, in words."""
    left = ", ".join(open_places(text))
    return ([f"{left} to be filled in"] if left else []) + disagreements(text, config, plan=plan, task=task)
