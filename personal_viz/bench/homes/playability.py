"""Measures how well a home serves its episodes: the figures of `personal-viz homes`, for one scene or many together.

Dataset -> plan -> scene -> `HomeFacts` (counts, in the worker process) -> `HomesReport` (shares, as JSON).
"""

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from personal_viz.bench.homes.sightlines import view_points_ok
from sim.authoring.findable import FindVerdict, find_verdicts
from sim.copies.glb_writer import glb_from_mesh
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.cells import cells_from_runs
from sim.homes.kind import scene_label, scene_labels
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import HomePlan, plan_of
from sim.homes.recovered.plans import recover_plan
from sim.homes.recovered.recorded import original_places
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.rules import success_region
from sim.types import SceneKind
from sim.walk.navigation_map import NavigationMap
from sim.words.english import how_many

from .held_out import Served, held_out_ratios, path_ratios, recorded_walk, served, starts_on_floor
from .picture_and_walk import Count, PictureAndWalk, forwards, picture_and_walk

_MODEL = ConfigDict(frozen=True, extra="forbid")
_PLACES = 50
"""Places of a storey from which ways to the next one are sought."""


@dataclass(frozen=True, slots=True)
class BuiltHome:
    """A home ready to be measured."""

    plan: HomePlan | None
    """None for a scan."""
    scene: Scene
    is_recovered: bool
    """False if its plan lies beside the episodes (invented, or corrected by hand), or if it is a scan."""
    build_s: float
    """Wall-clock seconds."""


class EditionFigures(BaseModel):
    """What one edition of the dataset gave to recovered homes; what several editions hold counts for the first."""

    model_config = _MODEL
    folder: str
    starts: int
    """Places where episodes start."""
    view_points: int
    """Places of view points."""
    objects: int
    left_out: tuple[str, ...] = ()
    """SCENE/NAME of each object that contradicts an earlier edition."""


@dataclass(frozen=True, slots=True)
class HomeFacts:
    """Counts for one home, from which shares over any number of homes are computed."""

    name: str
    scene_kind: SceneKind
    is_playable: NDArray[np.bool_]
    """(N,) per episode: the start is on the map, the home has the target, and paths lead to its view point and to a
    place from which STOP succeeds."""
    ratios: NDArray[np.float64]
    """(N,) our path length over the recorded one; inf without a path."""
    held_out: NDArray[np.float64] | None
    """(M,) the same ratio for the held-out episodes of every fold; None = not measured."""
    view_points: tuple[int, int]
    """Number of original view points that are standable and see their object, and of all original view points."""
    cells: tuple[int, int]
    """Number of walkable cells that are guessed, and of all walkable cells; (0, 0) for a home without cells."""
    verdicts: tuple[FindVerdict, ...]
    agreement: PictureAndWalk
    area_m2: float
    """Walkable area seen from above, all storeys."""
    storeys: int
    lifts: int
    """Number of neighbouring storeys that no walk joins."""
    missing_storeys: tuple[str, ...]
    """Names of storeys that no record tells of."""
    build_s: float
    """Time to build plan, mesh and navigation map (wall-clock seconds)."""
    triangles: int
    """Number of triangles of the whole home."""
    glb_mb: float
    """Size of the whole home as one GLB file, 10^6 bytes."""
    sources: tuple[EditionFigures, ...] = ()
    """Editions that a recovered home was made from."""
    other: Served | None = None
    """Episodes of an edition that it was not made from; None = not asked."""


class OtherFigures(BaseModel):
    """Episodes of an edition that the homes were not made from; what these hold too is left out."""

    model_config = _MODEL
    episodes: int
    playable: float | None
    """Share of episodes with a path from the start to `view_points[0]` of the target."""
    ratio_median: float | None
    """Median of our path length over the recorded one, over episodes with a path."""
    within_5: float | None
    """Share of all episodes whose path length is within 5 % of the recorded one."""
    within_10: float | None
    starts_on_floor: float | None
    """Share of episodes that start within 25 cm of our floor (planar, on the same storey)."""


class Figures(BaseModel):
    """Figures of one or more homes; shares are in [0, 1], null if there is nothing to take a share of."""

    model_config = _MODEL
    episodes: int
    playable: float | None
    """Share of episodes whose start, target and path exist, and that can be won."""
    ratio_median: float | None
    """Median of our path length over the recorded one, over episodes with a path."""
    ratio_p95: float | None
    within_5: float | None
    """Share of all episodes whose path length is within 5 % of the recorded one."""
    within_10: float | None
    heldout_split_within_10: float | None
    """Share of held-out episodes within 10 %, with the home recovered from the other two splits, over all folds."""
    heldout_n: int | None
    """Number of held-out episodes; null if they were not measured."""
    viewpoints_ok: float | None
    """Share of original view points that are standable and see their object."""
    viewpoints_n: int
    guessed_area: float | None
    """Share of the walkable area that is guessed."""
    findable: float | None
    """Share of episodes whose target can be told from similar objects; see sim/authoring/findable.py."""
    phantom: float | None
    """Share of forwards that collide although the picture shows nothing within reach."""
    phantom_free_ahead: float | None
    """Share of collisions with at least 0.5 m of visibly free space ahead."""
    mesh_over_map: float | None
    """Floor area on which a body fits in the drawn mesh, over the navigation map's."""
    storey_pairs_joined: float | None
    """Share of pairs of a start and a view point on two storeys that the drawn mesh joins."""
    floating: float | None
    """Share of objects more than 10 cm from everything else."""
    in_walls: float | None
    """Share of objects with more than 20 % of their surface inside a wall."""
    on_beds: int
    """Number of beds on which one can walk."""
    beds: int
    clearance_starts: float | None
    """Share of starts with less room around them than the body's radius."""
    clearance_views: float | None
    """The same share of view points."""
    area_m2: float
    storeys: int
    lifts: int
    """Number of neighbouring storeys that no walk joins, so that only a lift could; none is drawn."""
    storeys_missing_hint: tuple[str, ...]
    """SCENE/NAME of each storey that a home must have by the names of its others, but that no record tells of."""
    sources: tuple[EditionFigures, ...]
    """What recovered homes were made from: the dataset, then each edition of its evidence."""
    other: OtherFigures | None
    """Episodes of the edition of `--test-on`; null without it."""


class HomeFigures(Figures):
    """One home's figures."""

    build_s: float
    triangles: int
    glb_mb: float
    scene_kind: SceneKind
    scene_label: str
    """The warning that results in homes of this kind must carry; empty for scans."""
    not_findable: tuple[str, ...]
    """SPLIT/SCENE/ID of each episode whose target cannot be told from similar objects, or is hardly seen."""
    why_not_findable: dict[str, str]
    """The reason for each episode in `not_findable`."""


class HomesReport(BaseModel):
    """The document that `personal-viz homes --json` prints."""

    model_config = _MODEL
    total: Figures
    """Over all scenes together: pooled episodes, view points and areas, not means of the scenes' shares."""
    scenes: dict[str, HomeFigures]

    @property
    def labels(self) -> tuple[str, ...]:
        """The warnings that results in these homes must carry."""
        return scene_labels(home.scene_kind for home in self.scenes.values())


def build_home(dataset: PersonalDataset, name: str, *, scenes_dir: Path | None = None) -> BuiltHome:
    """The scan, or else the plan that lies beside the episodes, or else the recovered one, with its scene and the time
    that it took.

    The time is a first visitor's wait only if the cache folder is empty.

    Raises:
        DatasetError: The scene is unknown or its files are damaged.
        SceneError: The home cannot be built, or its scan cannot be used.
    """
    began = time.perf_counter()
    if scenes_dir is not None:
        scene = open_scene(dataset, name, scenes_dir=scenes_dir)
        return BuiltHome(None, scene, is_recovered=False, build_s=time.perf_counter() - began)
    given = plan_of(dataset, name)
    plan = given or recover_plan(dataset, name)
    scene = scene_from_plan(plan)
    return BuiltHome(plan, scene, is_recovered=given is None, build_s=time.perf_counter() - began)


def measure_home(
    dataset: PersonalDataset, home: BuiltHome, *, folds: bool = True, test_on: PersonalDataset | None = None
) -> HomeFacts:
    """All facts of one home. A scan has no plan, so nothing of it is guessed, and which targets texts tell apart is not
    known.

    Args:
        dataset: Holds the home's episodes.
        home: From `build_home`.
        folds: Whether to recover the home three more times, each from two splits. Scans, and homes whose plan lies
            beside the episodes, have no folds.
        test_on: Another edition, for whose episodes the home is asked.

    Raises:
        DatasetError: The files are damaged.
        SceneError: The home cannot be built from two splits.
    """
    plan, scene = home.plan, home.scene
    episodes, goals = list(dataset.episodes(scenes=(scene.name,))), dataset.goals(scene.name)
    ratios = path_ratios(map(recorded_walk, episodes), scene.navigation)
    cells = None if plan is None or plan.cells is None else cells_from_runs(plan.cells.walkable)
    caster = Raycaster(scene.mesh)
    return HomeFacts(
        name=scene.name,
        scene_kind=scene.kind,
        is_playable=np.isfinite(ratios)
        & _starts_and_targets_exist(episodes, scene)
        & _can_be_won(episodes, scene.navigation),
        ratios=ratios,
        held_out=held_out_ratios(dataset, scene.name) if folds and home.is_recovered else None,
        view_points=view_points_ok(scene, goals) if scene.objects else (0, 0),
        cells=(0, 0) if cells is None else (int(cells.guessed.sum()), len(cells.guessed)),
        verdicts=() if plan is None else find_verdicts(episodes, plan, scene, renderer=caster),
        agreement=picture_and_walk(
            scene,
            starts=np.array([episode.start.position for episode in episodes]),
            views=np.concatenate([original_places(goal) for goal in goals.values()]),
            caster=caster,
        ),
        area_m2=_area(scene, plan),
        storeys=len(scene.navigation.storey_heights if plan is None else plan.storeys),
        lifts=_lifts(scene.navigation),
        missing_storeys=scene.missing_storeys,
        build_s=home.build_s,
        triangles=len(scene.mesh.faces),
        glb_mb=len(glb_from_mesh(scene.mesh)) / 1e6,
        sources=() if plan is None or not home.is_recovered else _sources(dataset, plan),
        other=None if test_on is None else served(test_on, dataset, scene.name, scene.navigation),
    )


def report_of(homes: Sequence[HomeFacts]) -> HomesReport:
    """The figures of each home and of all homes together."""
    return HomesReport(total=_figures(homes), scenes={home.name: _home_figures(home) for home in homes})


def _starts_and_targets_exist(episodes: Sequence[Episode], scene: Scene) -> NDArray[np.bool_]:
    """(N,) whether the start is on the map and the home holds every right object; without semantics nobody knows."""
    names = {item.name for item in scene.objects}
    has_targets = [not names or names.issuperset(episode.record.object_names) for episode in episodes]
    is_near = starts_on_floor([episode.record.start_position for episode in episodes], scene.navigation)
    return is_near & np.array(has_targets, bool)


def _can_be_won(episodes: Sequence[Episode], navigation: NavigationMap) -> NDArray[np.bool_]:
    """(N,) whether a path leads from the start to a place from which STOP succeeds."""
    found = np.zeros(len(episodes), bool)
    asked = [tuple(episode.record.object_names) for episode in episodes]
    for names in set(asked):
        same = [number for number, one in enumerate(asked) if one == names]
        region = success_region(episodes[same[0]], navigation)
        if len(region):
            starts = np.array([episodes[number].start.position for number in same])
            found[same] = np.isfinite(navigation.distances(starts, region))
    return found


def home_facts(scene: Scene, plan: HomePlan) -> str:
    """A sentence on what is guessed, missing or not as drawn in a home without its scan."""
    phantom, _ = forwards(scene, Raycaster(scene.mesh))
    facts = [f"{_share(*phantom):.1%} of forwards are blocked by what the picture does not show"]
    if plan.cells is not None:
        cells = cells_from_runs(plan.cells.walkable)
        facts.append(f"{cells.guessed.mean():.0%} of the floor is guessed")
    if lifts := _lifts(scene.navigation):
        facts.append(f"{how_many(lifts, 'storey')} without stairs to the next")
    if plan.missing_storeys:
        facts.append(f"no record tells of: {', '.join(plan.missing_storeys)}")
    return f"{'; '.join(facts)}."


def _lifts(navigation: NavigationMap) -> int:
    """Number of neighbouring storeys of which less than half of the places on the lower have a way to the upper."""
    rng = np.random.default_rng(0)
    places = [
        np.array([navigation.random_point(rng, storey_y=floor_y) for _ in range(_PLACES)])
        for floor_y in navigation.storey_heights
    ]
    joined = (np.isfinite(navigation.distances(low, high)).mean() for low, high in itertools.pairwise(places))
    return sum(share < 0.5 for share in joined)


def _sources(dataset: PersonalDataset, plan: HomePlan) -> tuple[EditionFigures, ...]:
    """The editions of a recovered plan, with their folders."""
    return tuple(
        EditionFigures(
            folder=str(edition.root),
            starts=source.starts,
            view_points=source.view_points,
            objects=source.objects,
            left_out=tuple(f"{plan.name}/{name}" for name in source.left_out),
        )
        for edition, source in zip((dataset, *dataset.evidence), plan.sources, strict=True)
    )


def _area(scene: Scene, plan: HomePlan | None) -> float:
    """Walkable square metres, each storey once."""
    if plan is not None and plan.cells is not None:
        return len(cells_from_runs(plan.cells.walkable).y) * plan.cells.grid.cell**2
    return sum(
        float(top_down.free.sum()) * top_down.grid.cell**2
        for top_down in map(scene.navigation.top_down, scene.navigation.storey_heights)
    )


def _home_figures(home: HomeFacts) -> HomeFigures:
    missed = {str(verdict.key): verdict.reason for verdict in home.verdicts if not verdict.findable}
    return HomeFigures(
        **_figures([home]).model_dump(),
        build_s=round(home.build_s, 2),
        triangles=home.triangles,
        glb_mb=round(home.glb_mb, 2),
        scene_kind=home.scene_kind,
        scene_label=scene_label(home.scene_kind),
        not_findable=tuple(missed),
        why_not_findable=missed,
    )


def _figures(homes: Sequence[HomeFacts]) -> Figures:
    """The figures pooled over homes, at least one."""
    ratios = np.concatenate([home.ratios for home in homes])
    playable = np.concatenate([home.is_playable for home in homes])
    measured = [home.held_out for home in homes if home.held_out is not None]
    held_out = np.concatenate(measured) if measured else np.empty(0)
    verdicts = [verdict for home in homes for verdict in home.verdicts]
    num_ok, num_views = np.sum([home.view_points for home in homes], axis=0).tolist()
    num_guessed, num_cells = np.sum([home.cells for home in homes], axis=0).tolist()
    finite = ratios[np.isfinite(ratios)]
    pooled = PictureAndWalk(
        *(Count(*np.sum(of, axis=0).tolist()) for of in zip(*(h.agreement for h in homes), strict=True))
    )
    return Figures(
        episodes=len(ratios),
        playable=_share(int(playable.sum()), len(playable)),
        ratio_median=_rounded(float(np.median(finite))) if len(finite) else None,
        ratio_p95=_rounded(float(np.percentile(finite, 95))) if len(finite) else None,
        within_5=_share_within(ratios, 0.05),
        within_10=_share_within(ratios, 0.10),
        heldout_split_within_10=_share_within(held_out, 0.10),
        heldout_n=len(held_out) if measured else None,
        viewpoints_ok=_share(num_ok, num_views),
        viewpoints_n=num_views,
        guessed_area=_share(num_guessed, num_cells) if num_cells else 0.0,
        findable=_share(sum(verdict.findable for verdict in verdicts), len(verdicts)),
        phantom=_share(*pooled.phantom),
        phantom_free_ahead=_share(*pooled.free_ahead),
        mesh_over_map=_share(*pooled.standing),
        storey_pairs_joined=_share(*pooled.storey_pairs),
        floating=_share(*pooled.floating),
        in_walls=_share(*pooled.in_walls),
        on_beds=pooled.on_beds.found,
        beds=pooled.on_beds.of,
        clearance_starts=_share(*pooled.close_starts),
        clearance_views=_share(*pooled.close_views),
        area_m2=round(sum(home.area_m2 for home in homes), 1),
        storeys=sum(home.storeys for home in homes),
        lifts=sum(home.lifts for home in homes),
        storeys_missing_hint=tuple(f"{home.name}/{name}" for home in homes for name in home.missing_storeys),
        sources=_summed([home.sources for home in homes if home.sources]),
        other=_other_figures([home.other for home in homes if home.other is not None]),
    )


def _summed(homes: Sequence[tuple[EditionFigures, ...]]) -> tuple[EditionFigures, ...]:
    """The same editions' figures over several homes."""
    return tuple(
        EditionFigures(
            folder=editions[0].folder,
            starts=sum(edition.starts for edition in editions),
            view_points=sum(edition.view_points for edition in editions),
            objects=sum(edition.objects for edition in editions),
            left_out=tuple(name for edition in editions for name in edition.left_out),
        )
        for editions in zip(*homes, strict=True)
    )


def _other_figures(homes: Sequence[Served]) -> OtherFigures | None:
    if not homes:
        return None
    ratios = np.concatenate([home.ratios for home in homes])
    on_floor = np.concatenate([home.on_floor for home in homes])
    finite = ratios[np.isfinite(ratios)]
    return OtherFigures(
        episodes=len(ratios),
        playable=_share(len(finite), len(ratios)),
        ratio_median=_rounded(float(np.median(finite))) if len(finite) else None,
        within_5=_share_within(ratios, 0.05),
        within_10=_share_within(ratios, 0.10),
        starts_on_floor=_share(int(on_floor.sum()), len(on_floor)),
    )


def _share_within(ratios: NDArray[np.float64], tolerance: float) -> float | None:
    return _share(int((np.abs(ratios - 1) <= tolerance).sum()), len(ratios))


def _share(part: int, whole: int) -> float | None:
    return _rounded(part / whole) if whole else None


def _rounded(value: float) -> float:
    return round(value, 4)
