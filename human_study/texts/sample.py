"""The size of a study in numbers, counted from its plan, for protocol, preregistration and budget."""

from collections import Counter
from dataclasses import dataclass

from sim.types import TaskKind

from ..design.plan import PlannedParticipant, StudyPlan
from ..design.study import StudyConfig
from .estimate import TimeEstimate, estimate_time
from .words import open_place

_WORDS: dict[TaskKind, str] = {"pan": "steering", "pog": "pointing"}


@dataclass(frozen=True, slots=True)
class TaskShare:
    """The people of one task."""

    task: TaskKind
    num_people: int
    num_trials: int
    """Counted ones, over all people."""
    fewest: int
    """Counted trials of the person with the fewest."""
    most: int
    longest: TimeEstimate
    """Of the person with the most trials."""
    total_s: float
    """Seconds of all people together, expected."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What a plan asks for."""

    shares: tuple[TaskShare, ...]
    """In the order of the study's tasks."""
    num_spare: int
    """People with a link but no trials of their own, who take what others leave."""
    num_episodes: int
    by_split: dict[str, int]
    by_kind: dict[str, int]
    """Homes by kind."""
    most_visits: int
    """Counted trials of one person in one home."""

    @property
    def num_people(self) -> int:
        """People with trials of their own."""
        return sum(share.num_people for share in self.shares)

    @property
    def num_trials(self) -> int:
        """Counted trials."""
        return sum(share.num_trials for share in self.shares)


def sample_of(config: StudyConfig, plan: StudyPlan) -> Sample:
    """The numbers of a plan."""
    main = {person.code: [trial for trial in person.trials if trial.phase == "main"] for person in plan.participants}
    busy = [person for person in plan.participants if main[person.code]]
    keys = {trial.key for trials in main.values() for trial in trials}
    visits = [count for trials in main.values() for count in Counter(trial.scene for trial in trials).values()]
    shares = [_share(config, task, [person for person in busy if person.task == task]) for task in config.task]
    return Sample(
        shares=tuple(share for share in shares if share.num_people),
        num_spare=len(plan.participants) - len(busy),
        num_episodes=len(keys),
        by_split=dict(sorted(Counter(key.split for key in keys).items())),
        by_kind=dict(sorted(Counter(scene.kind for scene in plan.scenes).items())),
        most_visits=max(visits, default=0),
    )


def people_text(sample: Sample | None) -> str:
    """How many people, trials, episodes and homes, as sentences."""
    if sample is None:
        return f"The number of participants is {open_place('plan.json')}."
    kinds = " and ".join(f"{count} {kind}" for kind, count in sample.by_kind.items())
    splits = ", ".join(f"{count} {split}" for split, count in sample.by_split.items())
    each = "; ".join(
        f"{_people(share.num_people)} with {range_text(share)} {_WORDS[share.task]} trials each"
        for share in sample.shares
    )
    homes, visits = sum(sample.by_kind.values()), sample.most_visits
    return (
        f"The study has places for {_people(sample.num_people)} ({each}), {sample.num_trials} trials in all, with "
        f"{sample.num_episodes} episodes ({splits}) in {homes} home{'s' if homes > 1 else ''} ({kinds}). Nobody meets "
        f"one home more than {'once' if visits == 1 else f'{visits} times'} in counted trials."
    )


def _people(count: int) -> str:
    return "1 person" if count == 1 else f"{count} people"


def range_text(share: TaskShare) -> str:
    """Counted trials per person: 30, or 28 to 30."""
    return f"{share.most}" if share.fewest == share.most else f"{share.fewest} to {share.most}"


def _share(config: StudyConfig, task: TaskKind, people: list[PlannedParticipant]) -> TaskShare:
    counts = [sum(trial.phase == "main" for trial in person.trials) for person in people]
    estimates = [estimate_time(config, num_trials=count, task=task) for count in counts]
    return TaskShare(
        task=task,
        num_people=len(people),
        num_trials=sum(counts),
        fewest=min(counts, default=0),
        most=max(counts, default=0),
        longest=max(
            estimates, key=lambda estimate: estimate.total_s, default=estimate_time(config, num_trials=0, task=task)
        ),
        total_s=sum(estimate.total_s for estimate in estimates),
    )
