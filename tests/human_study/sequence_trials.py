"""Trials of home sequences that bots do: an agent's run as key presses, and the right objects as clicks."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from human_study.design.study import StudyConfig
from human_study.export.verify import TrialHome
from human_study.store.store import StudyStore
from human_study.trial.commands import Click, Command, Confirm, GiveUp, Move, PressStop, Start
from human_study.trial.events import Event
from human_study.trial.searches import SearchTexts, sequence_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import terms_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Goal
from sim.episodes.sequence_files import HomeSequence
from sim.homes.open_home import open_scene
from sim.sequences.playing import SequenceJob, open_job
from sim.sequences.runs import SequenceRun
from sim.sequences.searches import prompts_of, remembered_episode, search_episode, sequence_key
from sim.tasks.agent_makers import MakesShortestPath
from sim.tasks.pan import PanEnv
from sim.tasks.rules import scene_storeys
from sim.types import Action, TaskKind

from .small_world import study
from .trials import ray_down

EVERY_S = 0.5
"""Seconds between two commands."""


def sequence_study(**changes: object) -> StudyConfig:
    """A small study of sequences without pages before the trials."""
    told = {"sha256": "0" * 64, "history": "visible"}
    return study(**({"study": "sequences", "sequences": told, "task": ("pan", "pog")} | changes))


def home_of(root: Path, sequences: Sequence[HomeSequence]) -> TrialHome:
    """The invented home of these sequences."""
    dataset, scene_name = PersonalDataset(root), sequences[0].key.scene
    scene = open_scene(dataset, scene_name)
    return TrialHome(
        scene.navigation,
        scene.digest,
        scene_storeys(dataset.goals(scene_name).values()),
        dataset.episode,
        sequence={sequence_key(one): one for one in sequences}.__getitem__,
    )


def new_session(
    config: StudyConfig, home: TrialHome, sequence: HomeSequence, task: TaskKind, condition: str = "history_visible"
) -> PanSession | PogSession:
    """A session that nobody has started."""
    names = {
        "key": sequence_key(sequence),
        "task": config.sequence_task_for(sequence, task),
        "storeys": tuple(home.navigation.storey_heights),
        "scene_digest": home.scene_digest,
        "terms": terms_of(config, condition, task=task),
        "searches": SearchTexts.of(sequence, query_index=config.query_index),
    }
    if task == "pog":
        return PogSession(**names)
    env = PanEnv(sequence.start, home.navigation, renderer=None, max_steps=config.steps, prompts=prompts_of(sequence))
    return PanSession(env, **names)


def oracle_run(root: Path, folder: Path, sequence: HomeSequence, *, is_deaf: bool) -> SequenceRun:
    """The oracle's walk in a set's folder; a deaf one hears nothing after the intro."""
    key = sequence_key(sequence)
    job = SequenceJob(
        root,
        key.scene,
        (key,),
        sequences=folder,
        scenes_dir=None,
        agent=MakesShortestPath(),
        seed=0,
        ignores_messages=is_deaf,
    )
    return open_job(job)(key)


def presses(run: SequenceRun) -> Iterator[Command]:
    """The keys that walk an agent's run."""
    for step in run.steps:
        if step.action is Action.FOUND:
            yield from (PressStop(), PressStop())
        else:
            yield Move(step.action, "Key")


def clicks(sequence: HomeSequence, home: TrialHome, *, is_deaf: bool) -> Iterator[Command]:
    """Clicks on the right objects, or on those that the intro makes right, confirmed; giving up where there is none."""
    heights = home.navigation.storey_heights
    for index, subtask in enumerate(sequence.record.subtasks):
        episode = remembered_episode(sequence, index) if is_deaf else search_episode(sequence, index)
        wanted = episode.targets if subtask.mode == "all" else episode.targets[:1]
        for target in wanted:
            yield click_on(target, heights)
        yield from (Confirm(),) if wanted else (GiveUp(), GiveUp())


def click_on(target: Goal, heights: Sequence[float]) -> Click:
    """A click straight down on an object's middle."""
    x, y, z = target.position
    storey_y = max(height for height in heights if height <= y)
    return Click(ray_down(x, y + 2.0, z, storey_y=storey_y), (x, y, z))


def driven(session: PanSession | PogSession, commands: Sequence[Command], *, every_s: float = EVERY_S) -> list[Event]:
    """Starts the session and gives it all commands; returns its events."""
    in_order = [Start(), *commands]
    return [event for number, one in enumerate(in_order) for event in session.handle(one, every_s * number).events]


def do_sequence(
    store: StudyStore,
    code: str,
    order_no: int,
    sequence: HomeSequence,
    home: TrialHome,
    commands: Sequence[Command],
    *,
    condition: str | None = None,
) -> str:
    """One participant's whole trial, stored and finished; returns its id. `condition` may be a wrong one."""
    trial = store.open_trial(code, order_no)
    session = new_session(store.config, home, sequence, trial.task, condition or trial.condition)
    store.append_many(trial.trial_id, trial.epoch, driven(session, commands))
    events = [stored.event for stored in store.events(trial.trial_id)]
    names = {"navigation": home.navigation, "storeys": home.storeys, "participant": code}
    run = sequence_outcome(events, sequence, **names)
    assert run is not None
    store.finish_trial(trial.trial_id, run.end)
    return trial.trial_id
