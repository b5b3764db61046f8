"""`run --sequences`: an agent in home sequences, with or without its memory and the messages."""

from pathlib import Path
from typing import Literal, Protocol

from grounding.agents.goal_text import GoalText
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.errors import PersonalVizError
from sim.homes.kind import common_kind
from sim.sequences.playing import SequenceJob, run_sequences
from sim.sequences.writer import SequenceWriter
from sim.tasks.provenance import evidence_config, make_run_info
from sim.tasks.run_files import RunInfo, fitting_name, fitting_run_id
from sim.tasks.workers import Workers
from sim.types import ClutterLevel, EpisodeKey, SceneKind, Split
from sim.words.english import how_many

from ...progress import counted
from ..refusals import require_dataset, require_no_scan, require_none, sampled_sequences
from .named_agents import NamedAgent

_NOT_HERE = ("study", "episode", "rerun", "llm_url", "shard")
"""Options of `run` that sequences do not have."""


class SequenceOptions(Protocol):
    """The options of verb `run` that sequences have."""

    dataset: Path | None
    evidence: tuple[Path, ...]
    scenes_dir: Path | None
    scene: tuple[str, ...]
    split: tuple[Split, ...]
    limit: int | None
    sample_seed: int
    seed: int
    out: Path | None
    run_id: str | None
    label: str | None
    perception: str | None
    goal_text: GoalText
    clutter: ClutterLevel
    labels: Literal["on", "off"]
    memory: Literal["on", "off"]
    ignore_messages: bool


def play_sequences(verb: SequenceOptions, root: Path, agent: NamedAgent, *, processes: Workers) -> Path:
    """Plays the sequences of the set `root` that the run's folder does not hold yet; returns the folder.

    Raises:
        PersonalVizError: An option does not belong to sequences, the set or the homes cannot be read, or the agent
            fails; finished sequences are kept.
    """
    require_none(verb, _NOT_HERE, beside="--sequences")
    if verb.ignore_messages and verb.goal_text == "caption":
        raise PersonalVizError(
            "--goal-text caption beside --ignore-messages: expected another, because captions are those of the answer "
            "after all messages. Give --goal-text phrase or query."
        )
    dataset = PersonalDataset(require_dataset(verb.dataset), evidence=verb.evidence)
    keys = sampled_sequences(root, splits=verb.split, scenes=verb.scene, limit=verb.limit, seed=verb.sample_seed)
    kind = common_kind(dataset, {key.scene for key in keys}, verb.scenes_dir)
    require_no_scan(kind, clutter=verb.clutter)
    by_scene: dict[str, list[EpisodeKey]] = {}
    for key in keys:
        by_scene.setdefault(key.scene, []).append(key)
    info = _info(verb, root, dataset, kind, agent)
    folder = (verb.out or Path("runs")) / info.run_id
    writer = SequenceWriter(folder, info)
    left = sum(key not in writer.done for key in keys)
    print(
        f"{how_many(len(keys), 'sequence')} in {how_many(len(by_scene), 'scene')} ({info.scene_kind}), "
        f"{len(keys) - left} done before"
    )
    jobs = [
        SequenceJob(
            dataset.root,
            name,
            tuple(own),
            evidence=verb.evidence,
            sequences=root,
            scenes_dir=verb.scenes_dir,
            agent=agent.maker,
            seed=verb.seed,
            keeps_memory=verb.memory == "on",
            ignores_messages=verb.ignore_messages,
            clutter=verb.clutter,
            labels=verb.labels == "on",
        )
        for name, own in sorted(by_scene.items())
    ]
    with counted(info.who, left) as progress:
        run_sequences(jobs, writer, processes=processes, on_sequence=progress.add)
    print(f"Written to {folder}; see it with: personal-viz metrics {folder}")
    return folder


def _info(verb: SequenceOptions, root: Path, dataset: PersonalDataset, kind: SceneKind, agent: NamedAgent) -> RunInfo:
    """The contents of run.json."""
    who = verb.label or agent.who
    parts = [
        f"clutter {verb.clutter}" if verb.clutter else "",
        "memory" if verb.memory == "on" else "",
        "messages ignored" if verb.ignore_messages else "",
        agent.condition,
    ]
    sight = [verb.perception, verb.goal_text] if verb.perception else []
    level = ["evidence" if verb.evidence else "", "labels" if verb.labels == "on" else ""]
    told = ["sequences", who, *sight, *parts[:3], kind, *level, f"seed{verb.seed}"]
    return make_run_info(
        verb.run_id or fitting_run_id("-".join(filter(None, told)).replace(":", ".").replace(" ", "-")),
        who=fitting_name(who),
        who_kind="agent",
        condition=", ".join(filter(None, parts)) or "none",
        scene_kind=kind,
        dataset_digest=dataset.digest(),
        seed=verb.seed,
        config={
            "actions": "sequence7",
            "sequences": SequenceSet(root).digest(),
            "memory": verb.memory,
            "ignore_messages": verb.ignore_messages,
            "clutter": verb.clutter,
            **evidence_config(dataset),
            **agent.config,
        },
        made_for=agent.made_for,
        labels=verb.labels == "on",
    )
