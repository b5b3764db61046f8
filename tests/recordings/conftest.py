"""A two-room house of boxes, an episode in it and two runs; Rerun's strict mode for every test here."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from sim.episodes.schema import Episode, EpisodeRecord
from sim.mesh import Scene, TriangleMesh
from sim.render.raycast import Raycaster
from sim.tasks.pan import PanEnv
from sim.tasks.rules import score_run
from sim.tasks.run_files import Answer, AnswerMeasures, EpisodeEnd, EpisodeRun, EpisodeStart, Run
from sim.types import Action, EpisodeKey
from sim.walk.floor_grid import floor_grid_from_mesh

from ..sim import worlds
from ..sim.meshes import box, mesh_of
from ..sim.synthetic import example_episode
from ..sim.worlds import run_info as info

KEY = EpisodeKey("easy", "BoxHouse", "7")
BOXES = [  # low corner, high corner, colour
    ((-4.1, -0.1, -2.6), (4.1, 0.0, 2.6), (170, 140, 110)),
    ((-4.1, 0.0, -2.6), (4.1, 2.5, -2.5), (230, 226, 214)),
    ((-4.1, 0.0, 2.5), (4.1, 2.5, 2.6), (230, 226, 214)),
    ((-4.1, 0.0, -2.5), (-4.0, 2.5, 2.5), (214, 226, 230)),
    ((4.0, 0.0, -2.5), (4.1, 2.5, 2.5), (214, 226, 230)),
    ((-0.1, 0.0, -2.5), (0.1, 2.5, 0.6), (222, 214, 230)),
    ((-0.1, 0.0, 1.6), (0.1, 2.5, 2.5), (222, 214, 230)),
    ((2.6, 0.0, -2.3), (3.6, 0.75, -1.5), (150, 60, 40)),
    ((-3.6, 0.0, -2.3), (-2.2, 0.45, -1.5), (60, 90, 160)),
    ((-4.1, 2.5, -2.6), (4.1, 2.6, 2.6), (250, 250, 250)),
]
CHECKS = np.kron([[0, 1], [1, 0]], np.ones((8, 8)))[..., None] * np.array([60, 60, 40]) + np.array([120, 100, 80])
CHECKS = CHECKS.astype(np.uint8)


@pytest.fixture(autouse=True)
def strict_rerun() -> Iterator[None]:
    """Makes Rerun raise on bad data; by default it drops such data and only warns."""
    was = rr.strict_mode()
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(was)


def box_mesh(boxes: Sequence[tuple]) -> TriangleMesh:
    """A mesh of boxes; the first one, the floor, has a texture with squares of 1 m."""
    mesh = mesh_of(*(quad for low, high, rgb in boxes for quad in box(low, high, rgb=rgb)), textures=(CHECKS,))
    texture = np.where(np.arange(len(mesh.faces)) < 12, 0, -1).astype(np.int16)
    return replace(mesh, face_texture=texture, face_uv=mesh.vertices[mesh.faces][..., [0, 2]] / 2)


@pytest.fixture(scope="session")
def home() -> Scene:
    """Two rooms of 4 x 5 m joined by a 1 m wide door; the right one has a red table, the left one a blue bed."""
    mesh = box_mesh(BOXES)
    return Scene("BoxHouse", "invented", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())


@pytest.fixture(scope="session")
def renderer(home: Scene) -> Raycaster:
    """Renders the house."""
    return Raycaster(home.mesh)


@pytest.fixture(scope="session")
def episode() -> Episode:
    """An episode that asks for the table and starts in the room with the bed."""
    target = worlds.goal((3.1, 0.4, -1.9), (worlds.view_point((3.1, 0.0, -1.0)),), name="table_3")
    record = EpisodeRecord.model_validate(
        example_episode(
            scene=KEY.scene,
            owner="Nell",
            episode_id="7",
            object_category="table",
            object_id="table_3",
            description=("a red table", "", ""),
            summary="Nell keeps the red table | Ivo sleeps in the blue bed.",
            extracted_summary=("The red table belongs to Nell.",),
            query=("Find Nell's table.",),
            start_position=(-3.0, 0.0, 1.1),
            start_rotation=(0.0, 0.0, 0.0, 1.0),
            info={"geodesic_distance": 7.0, "euclidean_distance": 7.0, "closest_goal_object_id": 3},
        )
    )
    return Episode(KEY, record, (target,))


def walk(home: Scene, episode: Episode, actions: Sequence[Action], *, participant: str | None = None) -> EpisodeRun:
    """The run of these actions; if a person walks, each takes half a second."""
    env = PanEnv(episode.start, home.navigation, renderer=None)
    for number, action in enumerate(actions, start=1):
        env.step(action, t_s=0.5 * number if participant else 0.0)
    stopped = actions[-1] is Action.STOP
    measures = score_run(
        episode,
        env.poses,
        stopped=stopped,
        navigation=home.navigation,
        collisions=sum(step.collided for step in env.steps),
        scene_digest=home.digest,
    )
    place = {"position": episode.start.position, "yaw": episode.start.yaw, "participant": participant}
    end = EpisodeEnd(reason="stop" if stopped else "giveup", measures=measures)
    return EpisodeRun(start=EpisodeStart(**KEY._asdict(), **place), steps=env.steps, end=end)


def to_the_table() -> list[Action]:
    """The 40 actions that lead 6 m to the right through the door, 2.25 m to the table, and end with STOP."""
    turn_right, ahead = [Action.RIGHT] * 3, [Action.FORWARD]
    return [*turn_right, *ahead * 24, *[Action.LEFT] * 3, *ahead * 9, Action.STOP]


@pytest.fixture(scope="session")
def agent_run(home: Scene, episode: Episode) -> Run:
    """An agent that reaches the table."""
    return Run(info=info("straight.agent"), episodes=(walk(home, episode, to_the_table()),))


@pytest.fixture(scope="session")
def human_run(home: Scene, episode: Episode) -> Run:
    """A person who looks at the bed, bumps into the wall and gives up."""
    actions = [Action.LOOK_DOWN, *[Action.FORWARD] * 9, Action.RIGHT, Action.RIGHT, Action.LOOK_UP, Action.FORWARD]
    run = walk(home, episode, actions, participant="P07")
    return Run(info=info("study", who="human", who_kind="human"), episodes=(run,))


@pytest.fixture(scope="session")
def answer_run() -> Run:
    """A grounder with two candidates on an oracle map."""
    measures = AnswerMeasures(success=False, top3_success=True, planar_distance=6.0, distance_3d=6.0)
    candidates = ((-2.9, 0.3, -1.9), (3.0, 0.7, -1.8))
    answer = Answer(**KEY._asdict(), candidates=candidates, scores=(0.9, 0.8), measures=measures)
    return Run(info=info("grounder", scene_kind="oracle-map"), answers=(answer,))


def written(run: Run, folder: Path) -> Path:
    """Writes the run as a run folder and returns the folder."""
    folder.mkdir(parents=True)
    (folder / "run.json").write_text(run.info.model_dump_json())
    lines = [line for item in run.episodes for line in (item.start, *item.steps, item.end)]
    (folder / "steps.jsonl").write_text("".join(line.model_dump_json() + "\n" for line in lines))
    (folder / "answers.jsonl").write_text("".join(answer.model_dump_json() + "\n" for answer in run.answers))
    return folder
