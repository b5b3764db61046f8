"""Runs of home sequences on disk: `sequences.jsonl` beside `run.json`, one block of lines per sequence.

A block is `sequence`, `step`..., `sequence_end`; its steps are those of episodes (`sim.tasks.run_files`).
"""

from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.episodes.schema import NAME_PATTERN, Finite, Vector3
from sim.episodes.sequences import SubtaskKind
from sim.errors import RunFileError
from sim.tasks.run_files import AnswerMeasures, Length, Measures, Share, Step, read_lines
from sim.tasks.run_folders import SEQUENCES_FILE
from sim.types import Action, EndReason, EpisodeKey, Pose, Split, SuccessRule, TaskKind

VIEW_DISTANCE = 0.25
"""Metres of walking to a view point below which GOAT-Bench counts FOUND as a success."""
SearchReason = Literal["found", "steps", "stop", "unreached", "giveup", "timeout"]
_MODEL = ConfigDict(frozen=True, extra="forbid")


class SequenceStart(BaseModel):
    """First line of a sequence's block."""

    model_config = _MODEL
    kind: Literal["sequence"] = "sequence"
    schema_version: Literal[1] = 1
    task: TaskKind = "pan"
    split: Split
    scene: str = Field(pattern=NAME_PATTERN)
    sequence_id: str = Field(pattern=NAME_PATTERN)
    position: Vector3
    yaw: Finite
    participant: str | None = None
    """Public code of the person, None for agents."""


class AllMeasures(BaseModel):
    """Figures of a search for all right objects, by the radius of rule `paper`."""

    model_config = _MODEL
    recall: Share
    """Share of the right objects that were marked."""
    precision: Share
    """Share of the marks that are at a right object not marked before; 0 without marks."""
    best_m: Length | None
    """The shortest walk from where the search began to all right objects, in the best order; None = no path."""


class SearchEnd(BaseModel):
    """What came of one search."""

    model_config = _MODEL
    kind: SubtaskKind
    reason: SearchReason
    """`unreached` = STOP came before; in POG `found` = pointed at something. People give searches up (`giveup`), or run
    out of time (`timeout`), and go on with the next one."""
    message: int = Field(ge=0)
    """Index of the message that decides the answer."""
    is_after_news: bool
    """Whether anything was told between the intro and this search that does not decide its answer."""
    leg_m: Length | None
    """Shortest walk from a view point of the right object before, or from the start, to where this search succeeds by
    rule `paper`; None = no path."""
    measures: Measures | None
    """Measures of the walk from where the search began; None = unreached."""
    is_at_old: bool | None
    """Whether FOUND was at the object that was right before, and at no right one; None = there is none."""
    all: AllMeasures | None = None
    """Of a search for all right objects."""
    answer: AnswerMeasures | None = None
    """Of POG."""
    points: tuple[Vector3, ...] = ()
    """In POG: where the answer points, best first, or each marked object."""

    def succeeds(self, rule: SuccessRule | Literal["goat"]) -> bool | None:
        """Whether it succeeds; None where the rule has no usable point. All right objects must be marked, and no other.

        `goat` is GOAT-Bench's: FOUND less than `VIEW_DISTANCE` of walking from a view point.
        """
        if self.measures is None and self.answer is None:
            return False
        if self.all is not None:
            return self.all.recall == self.all.precision == 1
        if self.answer is not None or self.measures is None:
            return self.answer is not None and self.answer.success
        found = self.measures.rules["habitat" if rule == "goat" else rule]
        if found is None:
            return None
        if rule == "goat":
            return self.reason == "found" and found.dtg is not None and found.dtg < VIEW_DISTANCE
        return found.success


class SequenceEnd(BaseModel):
    """Last line of a sequence's block."""

    model_config = _MODEL
    kind: Literal["sequence_end"] = "sequence_end"
    reason: EndReason
    searches: tuple[SearchEnd, ...] = Field(min_length=1)


class SequenceRun(BaseModel):
    """One finished sequence of a person or an agent."""

    model_config = _MODEL
    start: SequenceStart
    steps: tuple[Step, ...]
    end: SequenceEnd

    @model_validator(mode="after")
    def _as_many_steps_as_measured(self) -> "SequenceRun":
        measured = sum(search.measures.num_steps for search in self.end.searches if search.measures is not None)
        if measured != len(self.steps):
            raise ValueError(f"{measured} step lines as the searches' num_steps say, found {len(self.steps)}")
        if self.steps and any(step.action is Action.STOP for step in self.steps[:-1]):
            raise ValueError("STOP as the last action only")
        return self

    @property
    def key(self) -> EpisodeKey:
        """The sequence, named as an episode is."""
        return EpisodeKey(self.start.split, self.start.scene, self.start.sequence_id)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Start pose and the pose after each step; len(steps) + 1."""
        return (Pose(self.start.position, self.start.yaw), *(step.pose for step in self.steps))

    @property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """Of each search, the index of its first step and of the one after its last; equal for one without steps."""
        counts = [0 if search.measures is None else search.measures.num_steps for search in self.end.searches]
        ends = tuple(accumulate(counts))
        return tuple(zip((0, *ends[:-1]), ends, strict=True))


def read_sequence_runs(folder: Path) -> tuple[SequenceRun, ...]:
    """The sequences of a run folder; () where it holds none. An incomplete last block is left out.

    Raises:
        RunFileError: A line is not valid or is in the wrong place.
    """
    path = folder / SEQUENCES_FILE
    return tuple(_blocks(path)) if path.is_file() else ()


def _blocks(path: Path) -> Iterator[SequenceRun]:
    start: SequenceStart | None = None
    steps: list[Step] = []
    models = {"sequence": SequenceStart, "step": Step, "sequence_end": SequenceEnd}
    for number, line in read_lines(path, models=models):
        if isinstance(line, SequenceStart) and start is None:
            start, steps = line, []
        elif isinstance(line, Step) and start is not None:
            steps.append(line)
        elif isinstance(line, SequenceEnd) and start is not None:
            try:
                yield SequenceRun(start=start, steps=tuple(steps), end=line)
            except ValidationError as error:
                raise RunFileError(
                    f"{path}:{number}: the block is not whole: {error.errors()[0]['msg']}. Write the file again from "
                    "its source, or delete the damaged sequence's block."
                ) from None
            start = None
        else:
            expected = "'sequence'" if start is None else "'step' or 'sequence_end'"
            raise RunFileError(
                f"{path}:{number}: found a line of another kind; expected {expected} here. Write the file again from "
                "its source, or delete the damaged sequence's block."
            )
