"""Grounders in home sequences: each search is answered on the same map, from a table of owners that changes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import AgentError
from sim.sequences.pointing import PointSearches
from sim.sequences.runs import SequenceRun
from sim.sequences.searches import search_episode, sequence_key
from sim.sequences.writer import SequenceWriter
from sim.tasks.chat_turns import Transcript
from sim.tasks.workers import Workers, results, without
from sim.types import EpisodeKey

from ..phrases.ownership_text import parse_phrase
from .evaluate import BATCH, GroundJob, SceneGrounder


@dataclass(frozen=True, slots=True)
class SequenceGroundJob(GroundJob):
    """One scene's sequences for one worker."""

    sequences: Path | None = None
    """Folder of the set; `dataset_root` is that of the episodes from which the maps are made."""
    ignores_messages: bool = False
    """Whether nothing is told after the intro."""


@dataclass(frozen=True, slots=True)
class AnsweredSequence:
    """One sequence's result from a worker."""

    run: SequenceRun
    chat: Transcript
    """What was asked of a chat model for it."""


def evaluate_sequences(
    jobs: Sequence[SequenceGroundJob],
    writer: SequenceWriter,
    *,
    processes: Workers,
    on_sequence: Callable[[], None] = lambda: None,
) -> None:
    """Answers every job's sequences and appends each to `writer` in order; it skips those that `writer` already holds.

    Raises:
        PersonalVizError: A sequence could not be answered; all before it are on disk.
    """
    for answered in results(open_job, without(jobs, writer.done), processes=processes, batch=BATCH):
        writer.add_sequence(answered.run, chat=answered.chat)
        on_sequence()


def open_job(job: SequenceGroundJob) -> Callable[[EpisodeKey], AnsweredSequence]:
    """Makes the maps of the job's scene; returns a function that answers one of its sequences.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit a map.
    """
    assert job.sequences is not None, "a job without a set"
    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    grounder = SceneGrounder(dataset, job.scene, job.settings, folders=job.folders, model=job.model, budget=job.budget)
    found = {sequence_key(one): one for one in SequenceSet(job.sequences).sequences(scenes=(job.scene,))}

    def answered(key: EpisodeKey) -> AnsweredSequence:
        sequence = found[key]
        searches = PointSearches(
            sequence,
            storeys=grounder.storeys,
            query_index=job.query_index,
            ignores_messages=job.ignores_messages,
        )
        while not searches.is_over:
            phrases = None
            if job.settings.phrases == "dataset":
                phrases = true_phrases(sequence, 0 if job.ignores_messages else searches.index)
            grounding = grounder.ground(search_episode(sequence, searches.index), searches.task, phrases=phrases)
            points = tuple(candidate.position for candidate in grounding.candidates)
            searches.answer(points[:1] if searches.is_for_all else points)
        return AnsweredSequence(searches.run(), grounder.asked(key))

    return answered


def true_phrases(sequence: HomeSequence, index: int) -> tuple[str, ...]:
    """The phrases "X owns Y in Z" of the true ownership at a search, in the words of the intro's sentences.

    Raises:
        AgentError: The intro has no sentence for each edge.
    """
    intro = sequence.record.messages[0]
    if len(intro.extracted_summary) != len(intro.adds):
        raise AgentError(
            f"sequence {sequence.key}: the intro has {len(intro.extracted_summary)} sentences for {len(intro.adds)} "
            "edges; expected one each for --phrases dataset. Give --phrases rules."
        )
    told = zip(intro.adds, intro.extracted_summary, strict=True)
    words = {edge.object_name: parse_phrase(sentence).text for edge, sentence in told}
    return tuple(f"{edge.owner} owns {words[edge.object_name]}" for edge in sequence.ownership[index])
