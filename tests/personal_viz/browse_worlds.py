"""Small made-up episodes for the tests of `personal_viz.browse`: no file, no home."""

from collections.abc import Sequence

from personal_viz.browse.library import Library
from personal_viz.browse.object_links import SceneTexts
from personal_viz.study_app.home.homes import HomeLibrary
from sim.episodes.schema import Episode, EpisodeRecord, Goal
from sim.tasks.run_files import Answer, Run
from sim.types import EpisodeKey, Split

from ..human_study.report_examples import pan_episode
from ..sim.worlds import run_info

CAPTIONS = {
    "couch_1": "a red couch under the round window",
    "couch_2": "a green couch beside the piano",
    "lamp_3": "a tall brass lamp near the door",
}


def goal(name: str, *, y: float = 0.0) -> Goal:
    """An object with one view point on a floor at height `y`."""
    return Goal.model_validate(
        {
            "position": (float(name[-1]), y + 0.5, 2.0),
            "object_id": int(name[-1]),
            "object_name": name,
            "object_category": name.partition("_")[0],
            "floor_id": "0",
            "view_points": [{"agent_state": {"position": (0.0, y, 2.0), "rotation": (0.0, 0.0, 0.0, 1.0)}, "iou": 0.5}],
        }
    )


def episode(
    episode_id: str,
    target: str,
    sentences: tuple[str, ...],
    *,
    owner: str = "Nell",
    split: Split = "easy",
    scene: str = "Hut",
    summary: str = "Nell and Ivo share a hut.",
) -> Episode:
    """`owner` asks for `target`; its caption is that of CAPTIONS."""
    record = EpisodeRecord.model_validate(
        {
            "episode_id": episode_id,
            "scene_id": f"made/{scene}.basis.glb",
            "scene_dataset_config": "",
            "object_category": target.partition("_")[0],
            "object_id": target,
            "description": (CAPTIONS.get(target, "a thing"), "", ""),
            "owner": owner,
            "floor_id": "0",
            "summary": summary,
            "extracted_summary": sentences,
            "query": (f"Find {owner}'s {target.partition('_')[0]}.",),
            "start_position": (0.0, 0.0, 0.0),
            "start_rotation": (0.0, 0.0, 0.0, 1.0),
            "info": {"geodesic_distance": 3.0, "euclidean_distance": 2.0, "closest_goal_object_id": 1},
        }
    )
    return Episode(EpisodeKey(split, scene, episode_id), record, (goal(target),))


def library(*episodes: Episode, runs: Sequence[Run] = ()) -> Library:
    """A library whose homes cannot be opened."""
    goals = {name: goal(name) for name in CAPTIONS}
    texts = {one.key.scene: SceneTexts.from_episodes(goals, episodes) for one in episodes}
    return Library(episodes, runs, texts, HomeLibrary({}.__getitem__))


def run_of(key: EpisodeKey, run_id: str, *, participant: str | None = None, points: int = 0) -> Run:
    """A walk of two steps, or an answer with `points` points."""
    who = {"who": "human", "who_kind": "human"} if participant else {}
    info = run_info(run_id, scene_kind="invented", **who)
    if points:
        split, scene, episode_id = key
        candidates = tuple((float(place), 0.5, 0.0) for place in range(points))
        return Run(info=info, answers=(Answer(split=split, scene=scene, episode_id=episode_id, candidates=candidates),))
    return Run(info=info, episodes=(pan_episode(key, success=True, steps=2, code=participant),))
