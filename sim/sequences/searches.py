"""A home sequence as searches: what may be told of each, and each as an episode, with its truth."""

import dataclasses
import math
from collections.abc import Sequence

from sim.episodes.schema import Episode, EpisodeInfo, Goal
from sim.episodes.sequence_files import HomeSequence, search_record
from sim.episodes.sequences import Edge, SequenceRecord
from sim.types import MAX_STEPS, SEQUENCE7, Action, EpisodeKey, News, Prompt, Task


def sequence_key(sequence: HomeSequence) -> EpisodeKey:
    """The sequence's name in runs, where it stands as an episode does."""
    return EpisodeKey(sequence.record.split, sequence.key.scene, sequence.key.sequence_id)


def sequence_task(
    sequence: HomeSequence,
    *,
    query_index: int = 0,
    max_steps: int = MAX_STEPS,
    actions: tuple[Action, ...] = SEQUENCE7,
) -> Task:
    """The part of a sequence that may be seen before its first search: the intro and the first query.

    Args:
        sequence: The sequence.
        query_index: Which of a query's paraphrases is read; a query with fewer begins again with its first.
        max_steps: Steps of each search.
        actions: The actions that may be taken.
    """
    first = prompts_of(sequence, query_index=query_index)[0]
    return Task("pan", sequence.record.messages[0].text, (first.query,), max_steps=max_steps, actions=actions)


def prompts_of(sequence: HomeSequence, *, query_index: int = 0, ignores_messages: bool = False) -> tuple[Prompt, ...]:
    """What is told at the beginning of each search; the intro is part of the task.

    Args:
        sequence: The sequence.
        query_index: As for `sequence_task`.
        ignores_messages: Whether nothing is told after the intro.
    """
    record, found = sequence.record, []
    for index, subtask in enumerate(record.subtasks):
        told = [message.text for message in record.messages[1:] if message.before == index and not ignores_messages]
        query = subtask.query[query_index % len(subtask.query)]
        found.append(Prompt(query, "\n".join(told) or None, is_for_all=subtask.mode == "all"))
    return tuple(found)


def task_so_far(whole: Task, news: Sequence[tuple[str, int]], query: str, index: int) -> Task:
    """The task of search `index` as an episode's: everything told so far is the description, and STOP stands for FOUND.

    Args:
        whole: The sequence's task.
        news: What was told after the intro, oldest first, each with the index of the search that it came before.
        query: The search's query.
        index: The search.
    """
    return dataclasses.replace(
        whole,
        description="\n".join((whole.description, *(text for text, _ in news))),
        queries=(query,),
        actions=tuple(dict.fromkeys(Action.STOP if action is Action.FOUND else action for action in whole.actions)),
        news=tuple(News(text, index - before) for text, before in news),
    )


def search_episode(sequence: HomeSequence, index: int) -> Episode:
    """One search as an episode that begins where the sequence does, with its truth; its texts are those of the intro.

    Makers of agents and the success rules take it.
    """
    record, subtask, targets = sequence.record, sequence.record.subtasks[index], sequence.targets[index]
    x, _, z = record.start_position
    info = subtask.info
    euclidean = info.euclidean_distance
    if euclidean is None:
        euclidean = min(math.hypot(target.position[0] - x, target.position[2] - z) for target in targets)
    closest = info.closest_goal_object_id
    episode = search_record(
        record,
        index,
        info=EpisodeInfo(
            geodesic_distance=info.geodesic_distance,
            euclidean_distance=euclidean,
            closest_goal_object_id=targets[0].object_id if closest is None else closest,
        ),
        episode_id=f"{record.sequence_id}_{index}"[-64:],
        object_id=subtask.object_names,
        description=subtask.captions or (("",),) * len(targets),
    )
    return Episode(EpisodeKey(record.split, sequence.key.scene, episode.episode_id), episode, targets)


def remembered_episode(sequence: HomeSequence, index: int) -> Episode:
    """The same search as somebody knows it who has heard the intro alone: its targets are what the owner had then.

    Without such an object they are (). Where one of several was given away since, it is the only one: the trap of
    `stale` and `changed`.
    """
    subtask = sequence.record.subtasks[index]
    first = set(sequence.record.messages[0].adds)
    goals = [
        goal for goal in sequence.of_category(subtask.object_category) if Edge(subtask.owner, goal.object_name) in first
    ]
    old = [goal for goal in goals if goal.object_name == subtask.old_object_id]
    return dataclasses.replace(search_episode(sequence, index), targets=tuple(old or goals))


def is_after_news(sequence: HomeSequence, index: int) -> bool:
    """Whether anything was told between the intro and a search that does not decide its answer."""
    record = sequence.record
    return any(
        message.before <= index
        for number, message in enumerate(record.messages)
        if number not in (0, record.subtasks[index].message)
    )


def told_before(record: SequenceRecord, index: int) -> list[tuple[str, str]]:
    """(kind, text) of all that changes just before a search: loans that end, named by their message, then messages."""
    ended = [("loan ends", message.text) for message in record.messages if message.until == index]
    return ended + [(message.kind, message.text) for message in record.messages if message.before == index]


def old_target(sequence: HomeSequence, index: int) -> Goal | None:
    """The object that would have been right before the message that decides a search; None = there was none."""
    old = sequence.record.subtasks[index].old_object_id
    return next((goal for goal in sequence.goals if goal.object_name == old), None)
