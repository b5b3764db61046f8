"""Oracle maps: grids whose cells hold the texts of the objects that the episode files know (GROUNDING.md, section 0).

They rank methods; they do not predict success on maps built from camera views. `oracle_home` reads the objects of a
home once; `objects_map` turns them into a storey's `FeatureMap`. It uses ground truth: grounders see only the map.
"""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Vector3
from sim.errors import SceneError, did_you_mean
from sim.mesh import Scene
from sim.types import GridSpec
from sim.walk.storeys import same_storey

from ..encoders.protocol import TextEncoder
from ..perception.paraphrase import ParaphraseLevel, paraphrase
from ..types import FeatureMap, map_from_cells

GRID_CELLS = 50
GRID_CELL = 1.0
"""50 x 50 cells of 1 m (paper, Sec. IV)."""


@dataclass(frozen=True, slots=True)
class OracleObject:
    """One goal object and its text."""

    name: str
    position: Vector3
    """Centre, world metres."""
    floor_id: str
    """The annotator's storey label."""
    floor_y: float
    """Height of the floor it belongs to."""
    text: str
    """Its caption where an episode targets it, else its category."""


@dataclass(frozen=True, slots=True)
class OracleHome:
    """Everything that the episode files say about a home, before any encoder is used."""

    scene: str
    grid: GridSpec
    centre_xz: tuple[float, float]
    """Middle of the x, z bounds of all objects and view points."""
    objects: tuple[OracleObject, ...]
    stands: tuple[tuple[str, Vector3], ...]
    """View points on the storey of the object that they look at: storey label, and floor point in world metres."""


def oracle_home(dataset: PersonalDataset, scene: str) -> OracleHome:
    """The home's objects with their texts, and the grid around them.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit the grid.
    """
    captions: dict[str, str] = {}
    for episode in dataset.episodes(scenes=(scene,)):
        for name, slots in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
            captions.setdefault(name, " ".join(slots))
    goals = dataset.goals(scene).values()
    objects = tuple(
        OracleObject(
            goal.object_name,
            goal.position,
            goal.floor_id,
            goal.floor_y,
            captions.get(goal.object_name) or goal.object_category,
        )
        for goal in goals
    )
    # floor_y is read once per goal: each call would search for the goal's floor again
    seen_from = [
        (floor_y, goal.floor_id, point.agent_state.position)
        for goal, floor_y in ((goal, goal.floor_y) for goal in goals)
        for point in goal.view_points
    ]
    known = np.array([item.position for item in objects] + [place for *_, place in seen_from]).reshape(-1, 3)
    if not len(known):
        raise SceneError(
            f"{dataset.root}: scene {scene!r} has no goal object; expected at least one in goals_by_category. "
            "Leave the scene out with --scene."
        )
    low, high = known[:, [0, 2]].min(axis=0), known[:, [0, 2]].max(axis=0)
    middle = (low + high) / 2
    corner = np.floor(middle) - GRID_CELLS / 2
    grid = GridSpec((float(corner[0]), float(corner[1])), GRID_CELL, (GRID_CELLS, GRID_CELLS))
    if not grid.contains(grid.rc_from_xz(np.array([low, high]))).all():
        raise SceneError(
            f"{dataset.root}: scene {scene!r} is {high[0] - low[0]:.1f} x {high[1] - low[1]:.1f} m; expected at most "
            f"{GRID_CELLS - 1} x {GRID_CELLS - 1} m, the size of an oracle map. Leave the scene out with --scene."
        )
    # the release lists points of other storeys too
    stands = tuple((label, at) for floor_y, label, at in seen_from if same_storey(at[1], floor_y))
    return OracleHome(scene, grid, (float(middle[0]), float(middle[1])), objects, stands)


def objects_map(home: OracleHome, encoder: TextEncoder, *, floor_id: str | None) -> FeatureMap:
    """The map `objects`: a cell holds the unit sum of its objects' unit text vectors, or nothing.

    It holds the objects of the storey with label `floor_id`; None merges all storeys.

    Raises:
        SceneError: No object has this label.
    """
    objects = [home.objects[index] for index in storey_objects(home, floor_id)]
    vectors = encoder.encode_texts([item.text for item in objects])
    cells = home.grid.rc_from_xz(np.array([(item.position[0], item.position[2]) for item in objects]))
    members: dict[tuple[int, int], list[int]] = defaultdict(list)
    for index, (row, col) in enumerate(cells.tolist()):
        members[(row, col)].append(index)
    heights = np.array([item.floor_y for item in objects])
    return map_from_cells(
        np.array([vectors[inside].sum(axis=0) for inside in members.values()]),
        np.array(list(members)),
        grid=home.grid,
        floor_y=lower_median(heights),
        encoder=encoder.name,
        centre_xz=home.centre_xz,
        cell_y=np.array([lower_median(heights[inside]) for inside in members.values()]),
        weights=np.array([len(inside) for inside in members.values()]),
    )


def storey_objects(home: OracleHome, floor_id: str | None) -> list[int]:
    """Indices into `home.objects` of the objects with this label; all for None.

    Raises:
        SceneError: No object has this label.
    """
    found = [index for index, item in enumerate(home.objects) if floor_id is None or item.floor_id == floor_id]
    if not found:
        labels = sorted({item.floor_id for item in home.objects})
        raise SceneError(
            f"{home.scene}: found no object with floor_id {floor_id!r}; expected one of {labels}."
            f'{did_you_mean(floor_id, labels)} "personal-viz validate" lists every problem.'
        )
    return found


def lower_median(heights: np.ndarray) -> float:
    """The lower median of the heights, which is always one of them: a mean of two storeys would lie on neither."""
    return float(np.sort(heights)[(len(heights) - 1) // 2])


def object_texts(
    dataset: PersonalDataset, scene: Scene, *, level: ParaphraseLevel = 0, seed: int = 0
) -> dict[int, str]:
    """Instance id to text: the caption of an episode that targets the object, else its category; paraphrased.

    This is ground truth: it enters a map only through `oracle_perception.OraclePerception`, and the map says so.
    Furniture that is in no episode (clutter) gets its category too.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit an oracle map.
    """
    captions = {item.name: item.text for item in oracle_home(dataset, scene.name).objects}
    return {
        item.instance_id: paraphrase(captions.get(item.name, item.category), item.category, level=level, seed=seed)
        for item in scene.objects
    }
