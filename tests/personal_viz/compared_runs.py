"""An invented home with runs of two people, two agents and two grounders, for the tests of `personal-viz compare`."""

from collections.abc import Sequence
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.tasks.rules import scene_storeys, score_answer, score_run
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, EpisodeStart, Run, RunInfo
from sim.types import Action, SceneKind

from ..sim.worlds import run_info
from .invented import invented_dataset

HOME = "Demo"
EVIL = "<script>alert('who')</script>"
"""Name of an agent."""


class Compared:
    """A dataset in `data` and run folders in `runs`."""

    def __init__(self, root: Path, *, seed: int = 3, scans: Path | None = None, kind: SceneKind = "invented") -> None:
        """Makes the home and six episodes; see `write_runs` for the runs."""
        self.data, self.runs = root / "data", root / "runs"
        invented_dataset(self.data, name=HOME, seed=seed, episodes_per_split=2)
        if kind != "invented":
            (self.data / "scenes" / f"{HOME}.plan.json").unlink()
        self.scans = self.data / "scenes" if kind == "scan" else scans
        self.kind = kind
        self.dataset = PersonalDataset(self.data)
        self.scene: Scene = open_scene(self.dataset, HOME, scenes_dir=self.scans)
        self.episodes: list[Episode] = list(self.dataset.episodes())

    def info(self, run_id: str, **changes: object) -> RunInfo:
        """`run.json` of a run in the home."""
        return run_info(run_id, **({"scene_kind": self.kind, "dataset_digest": self.dataset.digest()} | changes))

    def walk(self, episode: Episode, *, to_goal: bool, participant: str | None = None, turns: int = 0) -> EpisodeRun:
        """Turns, then the shortest path to the goal, or STOP at once; people need half a second per step."""
        env = PanEnv(episode.start, self.scene.navigation, renderer=None)
        agent = ShortestPathAgent(episode, self.scene.navigation)
        agent.reset(episode.task("pan"), env.camera, seed=0)
        observation = env.reset()
        while not env.is_over:
            action = agent.act(observation) if to_goal else Action.STOP
            action = Action.LEFT if len(env.steps) < turns else action
            observation = env.step(action, t_s=0.5 * (len(env.steps) + 1) if participant else 0.0)
        measures = score_run(
            episode,
            env.poses,
            stopped=True,
            navigation=self.scene.navigation,
            collisions=sum(step.collided for step in env.steps),
            scene_digest=self.scene.digest,
        )
        key, start = episode.key, episode.start
        named = {"split": key.split, "scene": key.scene, "episode_id": key.episode_id, "participant": participant}
        first = EpisodeStart(position=start.position, yaw=start.yaw, **named)
        return EpisodeRun(start=first, steps=env.steps, end=EpisodeEnd(reason="stop", measures=measures))

    def answer(self, episode: Episode, *points: tuple[float, float, float], participant: str | None = None) -> Answer:
        """Ranked answers at these offsets from the target's centre, metres."""
        centre = episode.targets[0].position
        candidates = tuple((centre[0] + dx, centre[1] + dy, centre[2] + dz) for dx, dy, dz in points)
        storeys = scene_storeys(self.dataset.goals(HOME).values())
        return Answer(
            split=episode.key.split,
            scene=episode.key.scene,
            episode_id=episode.key.episode_id,
            candidates=candidates,
            scores=() if participant else tuple(1.0 - 0.1 * rank for rank in range(len(points))),
            participant=participant,
            t_s=12.5 if participant else None,
            measures=score_answer(episode, candidates, storeys=storeys),
        )

    def write_runs(self) -> Path:
        """Two people who always succeed, `idle` which never does, EVIL which does in the first episode only; for the
        first episode also a person's click, and answers of a grounder in the home and of one on an oracle map."""
        first = self.episodes[0]
        study = [self.walk(e, to_goal=True, participant=code) for e in self.episodes for code in ("P01", "P02")]
        click = self.answer(first, (0.1, 0.0, 0.0), participant="P01")
        human = self.info("study", who="human", who_kind="human")
        written(Run(info=human, episodes=tuple(study), answers=(click,)), self.runs)
        idle = tuple(self.walk(episode, to_goal=False) for episode in self.episodes)
        written(Run(info=self.info("idle"), episodes=idle), self.runs)
        evil = [self.walk(episode, to_goal=episode is first, turns=12) for episode in self.episodes]
        written(Run(info=self.info("evil", who=EVIL), episodes=tuple(evil)), self.runs)
        far = self.answer(first, (2.5, 0.0, 0.0), (0.0, 0.0, 0.5))
        written(Run(info=self.info("grounder"), answers=(far,)), self.runs)
        near = self.answer(first, (0.5, 0.0, 0.0))
        written(Run(info=self.info("oracle", scene_kind="oracle-map"), answers=(near,)), self.runs)
        return self.runs


def written(run: Run, runs: Path) -> Path:
    """The run as a folder below `runs`."""
    folder = runs / run.info.run_id
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.json").write_text(run.info.model_dump_json())
    blocks: Sequence[object] = [line for item in run.episodes for line in (item.start, *item.steps, item.end)]
    (folder / "steps.jsonl").write_text("".join(line.model_dump_json() + "\n" for line in blocks))
    (folder / "answers.jsonl").write_text("".join(answer.model_dump_json() + "\n" for answer in run.answers))
    return folder
