"""The searches of a home sequence in a trial: what is told when, and the run that the trial's events give."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError
from sim.sequences.pointing import PointSearches
from sim.sequences.runs import SequenceEnd, SequenceRun, SequenceStart
from sim.sequences.scoring import run_from_sequence_env
from sim.sequences.searches import prompts_of, sequence_key
from sim.tasks.pan import PanEnv
from sim.types import EndReason, Pose, Prompt, Task
from sim.walk.navigation_map import NavigationMap

from .events import Clicked, Event, Open, SearchBegun, Unmarked
from .outcome import finished, left_searches, opening, require_own_points, search_ends, walked_steps
from .terms import HIDDEN
from .views import Note


@dataclass(frozen=True, slots=True)
class SearchTexts:
    """All texts of a sequence, later ones included: a session holds them, a view has those of its search."""

    notes: tuple[Note, ...]
    prompts: tuple[Prompt, ...]
    start: Pose
    """Where the sequence begins, world frame."""

    @classmethod
    def of(cls, sequence: HomeSequence, *, query_index: int = 0) -> Self:
        """The texts of a sequence; of each query the paraphrase with this index."""
        told = tuple(Note(message.text, message.before) for message in sequence.record.messages)
        return cls(told, prompts_of(sequence, query_index=query_index), sequence.start)

    def readable(self, index: int, *, has_history: bool) -> tuple[int, ...]:
        """Indices of the messages that can be read in a search."""
        return tuple(
            number
            for number, note in enumerate(self.notes)
            if note.search == index or (has_history and note.search < index)
        )

    def begun(self, index: int, t_s: float | None, *, has_history: bool) -> SearchBegun:
        """The event of showing a search."""
        return SearchBegun(
            t_s=t_s,
            search=index,
            num_searches=len(self.prompts),
            is_for_all=self.prompts[index].is_for_all,
            notes=self.readable(index, has_history=has_history),
        )

    def task(self, whole: Task, index: int, *, has_history: bool) -> Task:
        """The texts of a search: what can be read now is the description."""
        readable = self.readable(index, has_history=has_history)
        text = "\n".join(self.notes[number].text for number in readable)
        return dataclasses.replace(whole, description=text, queries=(self.prompts[index].query,))

    def shown(self, index: int, *, has_history: bool) -> dict[str, object]:
        """The fields of a `SearchView`."""
        prompt = self.prompts[index]
        return {
            "notes": tuple(self.notes[number] for number in self.readable(index, has_history=has_history)),
            "query": prompt.query,
            "search": index,
            "num_searches": len(self.prompts),
            "is_for_all": prompt.is_for_all,
        }


@dataclass(frozen=True, slots=True)
class SearchPart:
    """The events of one search."""

    begun: SearchBegun
    """The first one; it tells which messages could be read."""
    events: tuple[Event, ...]
    """All others until the next search begins."""
    end: Event | None
    """The one that ended it; None = it had no end of its own."""
    reason: EndReason | None

    @property
    def marks(self) -> tuple[Clicked, ...]:
        """The clicks that set the marks at the end of a search of POG: one, or several in a search for all.

        Raises:
            StudyError: A mark is taken away that was never set.
        """
        found: list[Clicked] = []
        for event in self.events:
            if isinstance(event, Clicked) and event.hit is not None:
                found = [*found, event] if self.begun.is_for_all else [event]
            elif isinstance(event, Unmarked):
                if event.index >= len(found):
                    raise StudyError(
                        f"search {self.begun.search}: takes mark {event.index} of {len(found)} away; expected one of "
                        "these. Run personal-viz study check-db."
                    )
                found.pop(event.index)
        return tuple(found)


def search_parts(events: Sequence[Event]) -> tuple[SearchPart, ...]:
    """The searches that a trial's events show, in order; () before the first one, and in an episode."""
    ends = search_ends(events)
    parts: list[tuple[SearchBegun, list[Event]]] = []
    for event in events:
        if isinstance(event, SearchBegun) and (not parts or event.search != parts[-1][0].search):
            parts.append((event, []))
        elif parts:
            parts[-1][1].append(event)
    return tuple(
        SearchPart(begun, tuple(found), *(ends[index] if index < len(ends) else (None, None)))
        for index, (begun, found) in enumerate(parts)
    )


def sequence_env(sequence: HomeSequence, navigation: NavigationMap, *, max_steps: int) -> PanEnv:
    """The environment of a sequence without pictures, for doing a trial again."""
    prompts = prompts_of(sequence)
    return PanEnv(sequence.start, navigation, renderer=None, max_steps=max_steps, prompts=prompts)


def sequence_outcome(
    events: Sequence[Event],
    sequence: HomeSequence,
    *,
    navigation: NavigationMap,
    storeys: Sequence[tuple[float, float]],
    participant: str,
) -> SequenceRun | None:
    """The finished trial of a sequence with each search scored; None if we failed or the participant came too late.

    Args:
        events: All events of the trial.
        sequence: The sequence.
        navigation: The home's.
        storeys: The home's, as of `sim.tasks.rules.scene_storeys`.
        participant: Code of the person.

    Raises:
        StudyError: The trial is not over, has another sequence, told other messages than it should or told them too
            early, takes a mark away that was never set, or a map point is not its pixel's.
        TaskStateError: There are steps after the end.
    """
    opened, reason = finished(events, sequence_key(sequence))
    if reason in ("technical", "abandoned"):
        return None
    _require_told(events, opened, sequence)
    if opened.task == "pan":
        end = _walked(events, opened, reason, sequence, navigation)
    else:
        end = _pointed(events, sequence, storeys)
    return sequence_run(events, end.model_copy(update={"reason": reason}), participant=participant)


def sequence_run(events: Sequence[Event], end: SequenceEnd, *, participant: str) -> SequenceRun:
    """A finished trial's events as a run with the given end.

    Raises:
        StudyError: The trial does not begin with `open`, or has no start pose, as an episode of POG.
    """
    opened = opening(events)
    if opened.position is None or opened.yaw is None:
        raise StudyError(f"trial of {opened.key}: has no start pose; expected a sequence. Give a trial of a sequence.")
    start = SequenceStart(
        task=opened.task,
        split=opened.split,
        scene=opened.scene,
        sequence_id=opened.episode_id,
        position=opened.position,
        yaw=opened.yaw,
        participant=participant,
    )
    return SequenceRun(start=start, steps=walked_steps(events), end=end)


def _walked(
    events: Sequence[Event], opened: Open, reason: EndReason, sequence: HomeSequence, navigation: NavigationMap
) -> SequenceEnd:
    env = sequence_env(sequence, navigation, max_steps=opened.max_steps)
    env.restore(walked_steps(events), left=left_searches(events))
    if env.end_reason != reason:
        raise StudyError(
            f"trial of pan {opened.key}: ends as {reason!r}; expected {env.end_reason!r}, which its steps give. Run "
            "personal-viz study check-db."
        )
    return run_from_sequence_env(sequence, env, scene_digest=opened.scene_digest, navigation=navigation).end


def _pointed(events: Sequence[Event], sequence: HomeSequence, storeys: Sequence[tuple[float, float]]) -> SequenceEnd:
    require_own_points(events)
    searches = PointSearches(sequence, storeys=storeys)
    for part in search_parts(events):
        points = [click.mark for click in part.marks if click.mark is not None] if part.reason == "click" else []
        searches.answer(points, without="timeout" if part.reason == "timeout" else "giveup")
    return searches.run().end


def _require_told(events: Sequence[Event], opened: Open, sequence: HomeSequence) -> None:
    """Raises StudyError where other messages could be read than those of the trial's condition, or other searches."""
    texts, shown = SearchTexts.of(sequence), [event for event in events if isinstance(event, SearchBegun)]
    ends, num_over = {id(event) for event, _ in search_ends(events)}, 0
    for event in events:
        num_over += id(event) in ends
        if isinstance(event, SearchBegun) and event.search != num_over:
            raise StudyError(
                f"trial of {opened.task} {opened.key}: search {event.search} was shown after the end of {num_over}; "
                f"expected search {num_over}. Run personal-viz study check-db."
            )
    for event in shown:
        expected = None
        if event.search < len(texts.prompts):
            expected = texts.begun(event.search, event.t_s, has_history=opened.condition != HIDDEN)
        if event != expected:
            found = event.model_dump_json(exclude={"t_s", "t_cli_ms", "kind"})
            raise StudyError(
                f"trial of {opened.task} {opened.key}: search {event.search} was shown as {found}; expected "
                f"{expected and expected.model_dump_json(exclude={'t_s', 't_cli_ms', 'kind'})}, as in condition "
                f"{opened.condition}. Run personal-viz study check-db."
            )
    order = list(dict.fromkeys(event.search for event in shown))
    if order != list(range(len(texts.prompts))):
        raise StudyError(
            f"trial of {opened.task} {opened.key}: showed the searches {order}; expected all {len(texts.prompts)}, one "
            "after the other. Run personal-viz study check-db."
        )
