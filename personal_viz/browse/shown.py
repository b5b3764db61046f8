"""What is shown of an episode: runs and answers of run folders in their colours, and layers that can be switched."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from recordings.traces import RUN_COLORS, Rgb
from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import EpisodeKey, SceneKind


@dataclass(frozen=True, slots=True)
class LayerChoice:
    """One flag per layer that can be switched."""

    view_points: bool = True
    region: bool = True
    names: bool = False
    """Category names over all objects."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One run or answer of an episode."""

    label: str
    """Who, unique among the shown of the episode."""
    kind: str
    """`human` or `agent`."""
    rgb: Rgb
    scene_kind: SceneKind | str
    """Where it was made; `oracle-map` for grounders that saw no home."""
    run: EpisodeRun | None = None
    answer: Answer | None = None

    @property
    def scene_digest(self) -> str | None:
        """Of the home in which a run was scored; None where nothing says."""
        if self.run is None or self.run.end.measures is None:
            return None
        return self.run.end.measures.scene_digest


class RunIndex:
    """All runs that were given, by episode."""

    def __init__(self, runs: Sequence[Run]) -> None:
        """Keeps them in the order in which they were given."""
        self._by_key: dict[EpisodeKey, list[tuple[Run, EpisodeRun | Answer]]] = {}
        for run in runs:
            for part in (*run.episodes, *run.answers):
                self._by_key.setdefault(part.key, []).append((run, part))

    def count(self, key: EpisodeKey) -> int:
        """How many runs and answers there are of an episode."""
        return len(self._by_key.get(key, ()))

    def of(self, key: EpisodeKey) -> tuple[Shown, ...]:
        """Runs and answers of an episode, people first."""
        entries = sorted(self._by_key.get(key, ()), key=lambda entry: entry[0].info.who_kind != "human")
        names = [_name(run, part) for run, part in entries]
        uses = Counter(names)
        shown = []
        for place, ((run, part), name) in enumerate(zip(entries, names, strict=True)):
            label = name if uses[name] == 1 else f"{name} ({run.info.run_id})"
            if any(other.label == label for other in shown):
                label = f"{label} #{place + 1}"
            shown.append(
                Shown(
                    label=label,
                    kind=run.info.who_kind,
                    rgb=RUN_COLORS[place % len(RUN_COLORS)],
                    scene_kind=run.info.scene_kind,
                    run=part if isinstance(part, EpisodeRun) else None,
                    answer=part if isinstance(part, Answer) else None,
                )
            )
        return tuple(shown)


def _name(run: Run, part: EpisodeRun | Answer) -> str:
    participant = part.start.participant if isinstance(part, EpisodeRun) else part.participant
    return f"{run.info.who} {participant}" if participant else run.info.who
