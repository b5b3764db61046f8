"""Runs grounders over episodes in worker processes and writes their scored answers as `Answer` lines."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.tasks.chat_turns import NO_CHAT, Transcript
from sim.tasks.rules import scene_storeys, score_answer
from sim.tasks.run_files import Answer
from sim.tasks.run_writer import RunWriter
from sim.tasks.workers import SceneJob, Workers, results, without
from sim.types import SPLITS, EpisodeKey, Split, Task

from ..agents.progress_notes import scene_note
from ..chat.budget import Budget
from ..chat.transcript import RecordedChat
from ..encoders.by_name import make_encoder
from ..encoders.protocol import ModelOptions
from ..maps.home_map import Memory
from ..methods.by_name import make_grounder
from ..phrases.sources import make_phrases
from ..types import Grounding
from .home_maps import MapFolders, home_maps, oracle_maps
from .seen_home import SeenHome
from .settings import GroundSettings as GroundSettings

BATCH = 200
"""Episodes per task of a worker, more than any scene of the release has (106): with fewer, two workers would explore
and map the same home."""
_WRITE_EVERY_S = 0.5
"""Seconds between writes: a write takes longer than a quick answer. Slow answers are written one by one."""
_SCORE_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class GroundJob(SceneJob):
    """One scene's episodes for one worker."""

    settings: GroundSettings
    folders: MapFolders | None = None
    """Folders of maps and explorations; None for oracle maps, which are made from the episode files alone."""
    model: ModelOptions | None = None
    """Options for `SceneGrounder`."""
    budget: Budget | None = None
    """Limits of a chat model, and the run folder that counts."""
    query_index: int = 0
    """Which of the query's paraphrases the grounder reads."""


@dataclass(frozen=True, slots=True)
class Answered:
    """One episode's result from a worker."""

    answer: Answer
    chat: Transcript
    """What was asked of a chat model for it."""


class SceneGrounder:
    """A scene's maps, phrases and grounder; answers its episodes. Views use it to show one episode's layers."""

    def __init__(
        self,
        dataset: PersonalDataset,
        scene: str,
        settings: GroundSettings,
        *,
        folders: MapFolders | None = None,
        model: ModelOptions | None = None,
        query_index: int = 0,
        budget: Budget | None = None,
    ) -> None:
        """Reads the scene's episode files; the home is explored and mapped when the first answer is needed.

        Args:
            folders: Folders of the maps; needed unless they are oracle maps.
            model: How a real encoder runs, with the autocast of the settings; None = its defaults.
            query_index: Which of the query's paraphrases the grounder reads.
            budget: Limits of a chat model, and the run folder that counts; None = neither.

        Raises:
            DatasetError: The scene is unknown or a file is damaged.
            SceneError: The home does not fit a map.
        """
        options = replace(model or ModelOptions(), autocast=settings.autocast)
        with scene_note(folders and folders.notes, scene) as say:
            say("loading the encoder")
            encoder = make_encoder(settings.map_encoder, options=options)
        if settings.map == "oracle":
            self._map_of = oracle_maps(dataset, scene, settings, encoder)
        else:
            assert folders is not None, "maps that are no oracle maps lie in a folder"
            self._map_of = home_maps(dataset, scene, settings, folders, encoder=encoder, model=options)
        self._settings, self._query_index = settings, query_index
        endpoint = settings.endpoint(budget)
        self._chat = None if endpoint is None else RecordedChat(endpoint)
        seen = None if folders is None else SeenHome(dataset, scene, settings, folders)
        self._grounder = make_grounder(settings.method, encoder, seed=settings.seed, chat=self._chat, seen=seen)
        self._phrases = make_phrases(settings.phrases, episodes=dataset.episodes(scenes=(scene,)), chat=self._chat)
        self.storeys = scene_storeys(dataset.goals(scene).values())
        """(lowest, highest) floor of each storey."""

    def memory(self, episode: Episode) -> Memory:
        """The map that the grounder gets for this episode; made once per storey."""
        return self._map_of(episode)

    def ground(
        self, episode: Episode, task: Task | None = None, *, phrases: tuple[str, ...] | None = None
    ) -> Grounding:
        """The grounder's answer and layers; it sees the map, the task and the phrases only.

        Args:
            episode: Says which map.
            task: The task; None = the episode's own.
            phrases: Who owns what; None = as the settings' source finds it in the task.
        """
        task = task or episode.task("pog", query_index=self._query_index)
        if not self._grounder.uses_phrases:
            phrases = ()
        elif phrases is None:
            phrases = self._phrases.phrases(task)
        return self._grounder.ground(self.memory(episode), task, phrases)

    def answered(self, episode: Episode) -> Answered:
        """The scored answer, and what was asked of a chat model for it."""
        return Answered(self.answer(episode), self.asked(episode.key))

    def asked(self, key: EpisodeKey) -> Transcript:
        """What was asked of a chat model since the last call, as for this episode or sequence."""
        return NO_CHAT if self._chat is None else self._chat.take(key)

    def answer(self, episode: Episode) -> Answer:
        """The scored answer, in the form of run files."""
        fallbacks = self._phrases.num_fallbacks
        grounding = self.ground(episode)
        candidates = grounding.candidates
        points = tuple(candidate.position for candidate in candidates)
        return Answer(
            split=episode.key.split,
            scene=episode.key.scene,
            episode_id=episode.key.episode_id,
            candidates=points,
            scores=tuple(round(candidate.score, _SCORE_DECIMALS) for candidate in candidates),
            storey_given=not self._settings.all_storeys,
            reason="click" if points else "giveup",
            fell_back=grounding.fell_back or self._phrases.num_fallbacks > fallbacks,
            measures=score_answer(episode, points, storeys=self.storeys),
        )


def select_jobs(
    dataset: PersonalDataset,
    settings: GroundSettings,
    *,
    splits: tuple[Split, ...] = SPLITS,
    scenes: tuple[str, ...] | None = None,
    limit: int | None = None,
    sample_seed: int = 0,
    folders: MapFolders | None = None,
    model: ModelOptions | None = None,
    keys: Sequence[EpisodeKey] | None = None,
    query_index: int = 0,
) -> list[GroundJob]:
    """One job per scene, in order of scene names.

    Args:
        scenes: Scenes to evaluate; None = all.
        limit: At most this many episodes of each split, a sample spread over the scenes; None = all.
        sample_seed: Seed of that sample.
        folders: Folders of the maps; None for oracle maps.
        keys: These episodes, whatever `splits`, `scenes` and `limit` say; None = as they say.
        query_index: Which of the query's paraphrases the grounder reads.

    Raises:
        DatasetError: A named scene is unknown, or a file is damaged.
    """
    if keys is None:
        found = dataset.sample(splits=splits, scenes=scenes, per_split=limit, seed=sample_seed)
        keys = [episode.key for episode in found]
    names = sorted({key.scene for key in keys})
    evidence = tuple(edition.root for edition in dataset.evidence)
    return [
        GroundJob(
            dataset.root,
            name,
            tuple(key for key in keys if key.scene == name),
            settings,
            folders,
            model,
            evidence=evidence,
            query_index=query_index,
        )
        for name in names
    ]


def evaluate(
    jobs: Sequence[GroundJob], writer: RunWriter, *, processes: Workers, on_episode: Callable[[], None] = lambda: None
) -> None:
    """Answers every job's episodes and appends each to `writer` in order; it skips those that `writer` already holds.

    Args:
        jobs: One per scene.
        processes: The workers; answers and their order do not depend on them.
        on_episode: Called after each answer is on disk.

    Raises:
        PersonalVizError: An episode could not be answered; all answers before it are on disk.
    """
    waiting: list[Answered] = []
    written_s = time.monotonic()

    def write() -> None:
        writer.add_answers([each.answer for each in waiting], chat=Transcript.joined(each.chat for each in waiting))
        for _ in waiting:
            on_episode()
        waiting.clear()

    try:
        for answered in results(open_job, without(jobs, writer.done), processes=processes, batch=BATCH):
            waiting.append(answered)
            if time.monotonic() - written_s >= _WRITE_EVERY_S:
                write()
                written_s = time.monotonic()
    finally:
        if waiting:
            write()


def open_job(job: GroundJob) -> Callable[[EpisodeKey], Answered]:
    """Makes the maps of the job's scene; returns a function that answers one of its episodes.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit a map.
    """
    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    grounder = SceneGrounder(
        dataset,
        job.scene,
        job.settings,
        folders=job.folders,
        model=job.model,
        query_index=job.query_index,
        budget=job.budget,
    )
    episodes = {episode.key: episode for episode in dataset.episodes(scenes=(job.scene,))}
    return lambda key: grounder.answered(episodes[key])
