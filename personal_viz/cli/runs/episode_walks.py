"""The walks of `run`: the jobs of its scenes, and what shows them in Rerun."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.mesh import Scene
from sim.tasks.agent_makers import AgentMaker
from sim.tasks.looks import HomeLook
from sim.tasks.observers import Observer
from sim.tasks.run_files import RunInfo
from sim.tasks.runner import AgentJob, WalkTerms
from sim.types import ClutterLevel, EpisodeKey, Pose

from ..output import recorded


@dataclass(frozen=True, slots=True)
class EpisodeWalks:
    """What the jobs of all scenes share."""

    dataset: PersonalDataset
    scenes_dir: Path | None
    clutter: ClutterLevel
    labels: bool
    maker: AgentMaker
    terms: WalkTerms = WalkTerms()  # noqa: RUF009 - frozen value
    look_at: Callable[[Scene, Pose], HomeLook] | None = None

    def jobs(
        self,
        by_scene: Mapping[str, Sequence[EpisodeKey]],
        make_observer: Callable[[Scene], Observer] | None,
        *,
        seed: int,
    ) -> list[AgentJob]:
        """One job per scene, in order of their names."""
        return [
            AgentJob(
                self.dataset.root,
                name,
                tuple(keys),
                evidence=tuple(edition.root for edition in self.dataset.evidence),
                scenes_dir=self.scenes_dir,
                agent=self.maker,
                seed=seed,
                clutter=self.clutter,
                labels=self.labels,
                make_observer=make_observer,
                terms=self.terms,
                look_at=self.look_at,
            )
            for name, keys in sorted(by_scene.items())
        ]


def keys_by_scene(keys: Sequence[EpisodeKey], scenes_dir: Path | None) -> dict[str, list[EpisodeKey]]:
    """The episodes, scene by scene; raises SceneError if a scene has no scan below `scenes_dir`."""
    found: dict[str, list[EpisodeKey]] = {}
    for key in keys:
        found.setdefault(key.scene, []).append(key)
    if scenes_dir is not None:
        from sim.homes.open_home import find_scan

        for name in found:
            find_scan(name, scenes_dir)
    return found


@contextmanager
def observing(
    rerun: str | None, left: Sequence[EpisodeKey], info: RunInfo, *, with_pixels: bool
) -> Iterator[Callable[[Scene], Observer] | None]:
    """Yields a function that makes observers for `--rerun`; checks files, and starts viewers, before any episode."""
    if rerun is None or not left:
        if rerun is not None:
            print("No episode is left to run, so nothing is recorded. Give another --run-id to run them again.")
        yield None
        return
    from recordings.observer import ObserveRuns

    if info.scene_kind == "scan" and not with_pixels:
        print("The homes are licensed scans: geometry and pictures are left out. --with-pixels stores them.")
    with recorded(rerun, left, said_to=sys.stdout) as sink:
        yield ObserveRuns(sink, info.model_dump_json(), with_pixels=with_pixels)
