"""A home sequence in the house of boxes, told by hand, and runs of it."""

from collections.abc import Sequence

from sim.episodes.schema import Goal, scan_suffix_from_id
from sim.episodes.sequence_files import HomeSequence, SequenceFile, resolve_sequence
from sim.episodes.sequences import SequenceRecord
from sim.mesh import Scene
from sim.sequences.pointing import PointSearches
from sim.sequences.runs import SequenceRun
from sim.sequences.scoring import run_from_sequence_env
from sim.sequences.searches import prompts_of
from sim.tasks.pan import PanEnv
from sim.types import Action, EndReason, EpisodeKey

from ..sim import worlds
from .conftest import to_the_table

KEY = EpisodeKey("hard", "BoxHouse", "told")
_ID = "made/BoxHouse.basis.glb"
_TABLES = (
    worlds.goal((3.1, 0.4, -1.9), (worlds.view_point((3.1, 0.0, -1.0)),), name="table_3"),
    worlds.goal((-2.9, 0.2, -1.9), (worlds.view_point((-2.9, 0.0, -1.0)),), name="table_4"),
)
_MESSAGES: list[dict[str, object]] = [
    {
        "before": 0,
        "kind": "intro",
        "text": "Nell owns the red table. Ivo owns the blue table.",
        "adds": [["Nell", "table_3"], ["Ivo", "table_4"]],
        "extracted_summary": ["Nell owns the red table in the hall", "Ivo owns the blue table in the den"],
    },
    {
        "before": 1,
        "kind": "swap",
        "text": "Nell and Ivo swapped tables.",
        "adds": [["Nell", "table_4"], ["Ivo", "table_3"]],
        "removes": [["Nell", "table_3"], ["Ivo", "table_4"]],
    },
]


def _subtask(owner: str, name: str, kind: str, message: int, old: str | None = None) -> dict[str, object]:
    return {
        "query": [f"Find {owner}'s table"],
        "owner": owner,
        "object_category": "table",
        "object_id": name,
        "kind": kind,
        "message": message,
        "old_object_id": old,
        "info": {"geodesic_distance": 3.0, "previous_geodesic": 3.0},
    }


_SUBTASKS = [
    _subtask("Nell", "table_3", "fresh", 0),
    _subtask("Nell", "table_4", "changed", 1, "table_3"),
    _subtask("Ivo", "table_3", "changed", 1, "table_4"),
]


def lent() -> HomeSequence:
    """The same people; Nell's table is lent for one search."""
    edges = {"adds": [["Una", "table_3"]], "removes": [["Nell", "table_3"]]}
    loan = {"before": 1, "kind": "lend", "text": "Nell lent Una a table for one search.", "until": 2, **edges}
    searches = [_SUBTASKS[0], *(_subtask("Ivo", "table_4", kind, 0) for kind in ("fresh", "revisit"))]
    return told(messages=[_MESSAGES[0], loan], subtasks=searches)


def told(
    goals: Sequence[Goal] = _TABLES,
    *,
    messages: Sequence[dict[str, object]] = _MESSAGES,
    subtasks: Sequence[dict[str, object]] = _SUBTASKS,
) -> HomeSequence:
    """Two people with a table each, who swap them after the first of three searches."""
    record = SequenceRecord.model_validate(
        {
            "sequence_id": KEY.episode_id,
            "split": KEY.split,
            "scene_id": _ID,
            "scene_dataset_config": "",
            "floor_id": "0",
            "start_position": (-3.0, 0.0, 1.1),
            "start_rotation": (0.0, 0.0, 0.0, 1.0),
            "messages": messages,
            "subtasks": subtasks,
        }
    )
    content = SequenceFile(
        goals_by_category={f"{KEY.scene}{scan_suffix_from_id(_ID)}_table": tuple(goals)},
        sequences=(record,),
        category_to_task_category_id={},
        category_to_scene_annotation_category_id={},
    )
    return resolve_sequence(KEY.scene, record, content)


def walked(home: Scene, sequence: HomeSequence, actions: Sequence[Action | EndReason]) -> SequenceRun:
    """The run of these actions, and of ends of searches without one."""
    env = PanEnv(sequence.start, home.navigation, renderer=None, prompts=prompts_of(sequence))
    for action in actions:
        if isinstance(action, Action):
            env.step(action)
        else:
            env.end_search(action)
    return run_from_sequence_env(sequence, env, scene_digest=home.digest, navigation=home.navigation)


def pointed(sequence: HomeSequence) -> SequenceRun:
    """A POG run that answers right, nothing, and at the old object."""
    searches = PointSearches(sequence, storeys=[(0.0, 0.0)])
    for points in ([(3.1, 0.4, -1.9), (0.5, 0.4, 0.0)], [], [(-2.9, 0.2, -1.9)]):
        searches.answer(points)
    return searches.run()


TO_THE_TABLE = [*to_the_table()[:-1], Action.FOUND]
STAYS = [*TO_THE_TABLE, Action.FOUND, Action.FOUND]
"""Right, at the old object, right: 40 steps and twice one."""
GIVES_UP = [Action.FOUND, Action.LEFT, Action.FOUND, Action.STOP]
"""Wrong, wrong, STOP."""
