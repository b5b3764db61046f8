"""`run` in home sequences, of a set or of a study: an agent with or without its memory and the messages."""

from collections.abc import Mapping
from dataclasses import dataclass, field
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
from sim.tasks.runner import WalkTerms
from sim.tasks.workers import Workers
from sim.types import SEQUENCE7, ClutterLevel, EpisodeKey, SceneKind, Split
from sim.words.english import how_many

from ...progress import counted
from ..refusals import require_dataset, require_no_scan, require_none, sampled_sequences
from .episode_walks import keys_by_scene
from .named_agents import NamedAgent

_NOT_HERE = ("episode", "rerun", "llm_url", "shard")
"""Options of `run` that sequences do not have."""


@dataclass(frozen=True, slots=True)
class SequenceWalks:
    """The sequences that an agent does, the homes as they are then, and what it may do in them."""

    dataset: PersonalDataset
    scenes_dir: Path | None
    sequences: Path
    """Folder of the set."""
    keys: tuple[EpisodeKey, ...]
    clutter: ClutterLevel
    labels: bool
    out: Path
    """Folder of the runs."""
    terms: WalkTerms = WalkTerms(actions=SEQUENCE7)  # noqa: RUF009 - frozen value
    name: str = "sequences"
    """First part of the run's name."""
    facts: Mapping[str, str | int] = field(default_factory=lambda: {"actions": "sequence7"})
    """Entries of `run.json` about whose sequences these are, and what the agent may do."""


class SequenceOptions(Protocol):
    """The options of verb `run` that sequences have."""

    dataset: Path | None
    sequences: Path | None
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


def walks_of_set(verb: SequenceOptions, root: Path) -> SequenceWalks:
    """What the options choose of the set `root`.

    Raises:
        PersonalVizError: It is nothing, or the set, the episodes or the homes cannot be read.
    """
    dataset = PersonalDataset(require_dataset(verb.dataset), evidence=verb.evidence)
    keys = sampled_sequences(root, splits=verb.split, scenes=verb.scene, limit=verb.limit, seed=verb.sample_seed)
    require_no_scan(common_kind(dataset, {key.scene for key in keys}, verb.scenes_dir), clutter=verb.clutter)
    out, labels = verb.out or Path("runs"), verb.labels == "on"
    return SequenceWalks(dataset, verb.scenes_dir, root, tuple(keys), verb.clutter, labels, out)


def require_options_of_sequences(verb: SequenceOptions) -> None:
    """Raises PersonalVizError where options of `run` do not fit home sequences."""
    require_none(verb, _NOT_HERE, beside="--sequences" if verb.sequences else "--study of home sequences")
    if verb.ignore_messages and verb.goal_text == "caption":
        raise PersonalVizError(
            "--goal-text caption beside --ignore-messages: expected another, because captions are those of the answer "
            "after all messages. Give --goal-text phrase or query."
        )


def play_sequences(verb: SequenceOptions, walks: SequenceWalks, agent: NamedAgent, *, processes: Workers) -> Path:
    """Plays the sequences that the run's folder does not hold yet; returns the folder.

    Raises:
        PersonalVizError: A home cannot be opened, or the agent fails; finished sequences are kept.
    """
    dataset, by_scene = walks.dataset, keys_by_scene(walks.keys, walks.scenes_dir)
    info = _info(verb, walks, common_kind(dataset, by_scene.keys(), walks.scenes_dir), agent)
    folder = walks.out / info.run_id
    writer = SequenceWriter(folder, info)
    left = sum(key not in writer.done for key in walks.keys)
    print(
        f"{how_many(len(walks.keys), 'sequence')} in {how_many(len(by_scene), 'scene')} ({info.scene_kind}), "
        f"{len(walks.keys) - left} done before"
    )
    jobs = [
        SequenceJob(
            dataset.root,
            name,
            tuple(own),
            evidence=tuple(edition.root for edition in dataset.evidence),
            sequences=walks.sequences,
            scenes_dir=walks.scenes_dir,
            agent=agent.maker,
            seed=verb.seed,
            keeps_memory=verb.memory == "on",
            ignores_messages=verb.ignore_messages,
            clutter=walks.clutter,
            labels=walks.labels,
            terms=walks.terms,
        )
        for name, own in sorted(by_scene.items())
    ]
    with counted(info.who, left) as progress:
        run_sequences(jobs, writer, processes=processes, on_sequence=progress.add)
    print(f"Written to {folder}; see it with: personal-viz metrics {folder}")
    return folder


def _info(verb: SequenceOptions, walks: SequenceWalks, kind: SceneKind, agent: NamedAgent) -> RunInfo:
    """The contents of run.json."""
    who = verb.label or agent.who
    parts = [
        f"clutter {walks.clutter}" if walks.clutter else "",
        "memory" if verb.memory == "on" else "",
        "messages ignored" if verb.ignore_messages else "",
        agent.condition,
    ]
    sight = [verb.perception, verb.goal_text] if verb.perception else []
    level = ["evidence" if walks.dataset.evidence else "", "labels" if walks.labels else ""]
    told = [walks.name, who, *sight, *parts[:3], kind, *level, f"seed{verb.seed}"]
    return make_run_info(
        verb.run_id or fitting_run_id("-".join(filter(None, told)).replace(":", ".").replace(" ", "-")),
        who=fitting_name(who),
        who_kind="agent",
        condition=", ".join(filter(None, parts)) or "none",
        scene_kind=kind,
        dataset_digest=walks.dataset.digest(),
        seed=verb.seed,
        config={
            **walks.facts,
            "sequences": SequenceSet(walks.sequences).digest(),
            "memory": verb.memory,
            "ignore_messages": verb.ignore_messages,
            "clutter": walks.clutter,
            **evidence_config(walks.dataset),
            **agent.config,
        },
        made_for=agent.made_for,
        labels=walks.labels,
    )
