"""Grid and object maps of an invented home: objects are mapped where they are, and wrong poses show."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from grounding.maps.grid_map import CellSums, GridMapBuilder
from grounding.maps.home_map import HomeMemory, ObjectMap
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.storeys import ViewOptions, floors_of_frames
from grounding.methods.baselines import MapCentre
from grounding.perception.segment_depth import DepthRegions
from grounding.perception.segments import InstanceIds, Segments
from grounding.robot.frames import read_robot_frames
from grounding.types import FeatureMap
from sim.errors import AgentError
from sim.frames import T_world_camera
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene, SceneObject
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import Camera, Frame, GridSpec, Pose, Task

from .mapped_views import ColourEncoder, IdEncoder, write_recording

CAMERA = Camera(width=320, height=240)
TASK = Task("pog", description="", queries=("Find the sofa",))
NEAR = 0.15
"""Largest distance between a mapped object and its box, metres."""


@dataclass(frozen=True)
class SeenHome:
    """A home with two storeys, and views of both."""

    scene: Scene
    frames: list[Frame]

    @property
    def encoder(self) -> IdEncoder:
        return IdEncoder(len(self.scene.objects))

    @property
    def well_seen(self) -> set[int]:
        """Ids that have at least 500 pixels within 4 m in some view."""
        ids: set[int] = set()
        for frame in self.frames:
            counts = np.bincount(frame.instance_ids[(frame.depth_m < 4) & (frame.depth_m > 0.2)])
            ids |= set(np.flatnonzero(counts >= 500).tolist()) - {0}
        return ids


@pytest.fixture(scope="module")
def home() -> SeenHome:
    from sim.render.raycast import Raycaster

    scene = scene_from_plan(invent_plan("Mapped", seed=4))
    rng = np.random.default_rng(5)
    poses = [
        Pose(tuple(scene.navigation.random_point(rng, storey_y=floor).tolist()), float(rng.uniform(-np.pi, np.pi)))
        for floor in scene.navigation.storey_heights
        for _ in range(24)
    ]
    Ts = np.array([T_world_camera(pose, CAMERA) for pose in poses])
    return SeenHome(scene, Raycaster(scene.mesh).render_batch(Ts, CAMERA))


def built(builder, frames) -> HomeMemory:
    builder.reset()
    for frame in frames:
        builder.add(frame)
    return builder.finish()


def apart(thing: SceneObject, low: np.ndarray, high: np.ndarray) -> float:
    """Metres between the box of an object and the box from low to high, both (2,) xz, seen from above."""
    centre, half = np.array(thing.centre)[[0, 2]], np.array(thing.size)[[0, 2]] / 2
    return float(np.linalg.norm(np.maximum(0, np.maximum(low - (centre + half), (centre - half) - high))))


def right_share(memory: HomeMemory, things: tuple[SceneObject, ...], cell: float) -> float:
    """Share of the pairs (cell, id in its vector) whose object is in or beside the cell."""
    by_id = {thing.instance_id: thing for thing in things}
    right = []
    for storey in memory.storeys:
        found = storey.memory
        assert isinstance(found, FeatureMap)
        for row, rc in zip(found.rows, found.rc, strict=True):
            middle = found.grid.xz_from_rc(rc)
            for number in np.flatnonzero(row > 0.01).tolist():
                is_near = apart(by_id[number], middle - cell / 2, middle + cell / 2) <= NEAR
                is_on_storey = abs(by_id[number].centre[1] - storey.floor_y - 1.2) < 1.6
                right.append(is_near and is_on_storey)
    assert right
    return float(np.mean(right))


@pytest.mark.slow
@pytest.mark.parametrize("cell", [1.0, 0.25])
def test_every_well_seen_object_is_mapped_to_a_cell_where_it_stands(home: SeenHome, cell: float) -> None:
    memory = built(GridMapBuilder(home.encoder, cell=cell), home.frames)
    assert right_share(memory, home.scene.objects, cell) >= 0.99
    said = {number for storey in memory.storeys for number in np.flatnonzero(storey.memory.rows.max(axis=0) > 0.01)}
    assert len(home.well_seen) >= 20
    assert len(home.well_seen - said) <= 1
    for thing in home.scene.objects:
        scores = [storey.memory.rows[:, thing.instance_id] for storey in memory.storeys]
        if thing.instance_id in home.well_seen & said:
            best = max(range(len(scores)), key=lambda index: scores[index].max(initial=0))
            found = memory.storeys[best].memory
            place = found.grid.xz_from_rc(found.rc[int(scores[best].argmax())])
            assert apart(thing, place - cell / 2, place + cell / 2) <= NEAR, thing


def turned_about_itself(frame: Frame) -> Frame:
    """The frame with the opposite sign of the yaw."""
    T = frame.T_world_camera.copy()
    flip = np.diag([-1.0, 1, 1])
    T[:3, :3] = flip @ T[:3, :3] @ flip
    return replace(frame, T_world_camera=T)


def upside_down(frame: Frame) -> Frame:
    """The frame with OpenGL camera axes read as OpenCV's."""
    return replace(frame, T_world_camera=frame.T_world_camera @ np.diag([1.0, -1, -1, 1]))


def mirrored(frame: Frame) -> Frame:
    """The frame with its columns from right to left."""
    return replace(frame, depth_m=frame.depth_m[:, ::-1].copy(), ids=frame.instance_ids[:, ::-1].copy())


@pytest.mark.parametrize("spoil", [turned_about_itself, upside_down, mirrored])
def test_wrong_yaw_axes_or_columns_put_objects_elsewhere(home: SeenHome, spoil) -> None:
    memory = built(GridMapBuilder(home.encoder, cell=0.25), [spoil(frame) for frame in home.frames])
    assert right_share(memory, home.scene.objects, 0.25) < 0.6


def test_storeys_are_found_while_mapping_and_get_their_own_maps(home: SeenHome) -> None:
    memory = built(GridMapBuilder(home.encoder), home.frames)
    heights = home.scene.navigation.storey_heights
    assert [storey.floor_y for storey in memory.storeys] == pytest.approx(heights, abs=0.05)
    assert memory.num_frames == 48
    assert all((storey.memory.cell_y == np.float32(storey.floor_y)).all() for storey in memory.storeys)
    for storey, floor in zip(memory.storeys, heights, strict=True):
        standing = [
            frame.T_world_camera[[0, 2], 3]
            for frame in home.frames
            if abs(frame.T_world_camera[1, 3] - floor - 1) < 0.5
        ]
        known = storey.occupancy.cells[tuple(storey.occupancy.grid.rc_from_xz(np.array(standing)).T)]
        assert (known != OCCUPIED).all()
        assert (storey.occupancy.cells == FREE).sum() * 0.05**2 > 15
    given = built(GridMapBuilder(home.encoder, views=ViewOptions(floors=heights)), home.frames)
    for one, other in zip(given.storeys, memory.storeys, strict=True):
        assert one.memory.grid == other.memory.grid
        assert len({*map(tuple, one.memory.rc.tolist())} ^ {*map(tuple, other.memory.rc.tolist())}) <= 2


def test_the_grid_equals_that_of_oracle_maps_if_their_middle_is_given(home: SeenHome) -> None:
    memory = built(GridMapBuilder(home.encoder, views=ViewOptions(centre_xz=(5.75, 3.25))), home.frames[:8])
    assert memory.storeys[0].memory.grid == GridSpec((-20.0, -22.0), 1.0, (50, 50))  # floor(middle) - 25
    alone = built(GridMapBuilder(home.encoder), home.frames[:8])
    assert memory.storeys[0].memory.centre_xz == alone.storeys[0].memory.centre_xz  # of the seen area, not as given


@pytest.mark.parametrize("given", [(5.75, 3.25), (-4.0, 12.5)])
def test_a_given_middle_does_not_change_the_answer(home: SeenHome, given: tuple[float, float]) -> None:
    known = built(GridMapBuilder(home.encoder), home.frames[:8]).storeys[0].memory
    memory = built(GridMapBuilder(home.encoder, views=ViewOptions(centre_xz=given)), home.frames[:8]).storeys[0].memory
    first, other = (MapCentre().ground(item, TASK, ()).candidates[0].position for item in (known, memory))
    assert first == other
    np.testing.assert_array_equal(memory.points_from_rc(memory.rc), known.points_from_rc(known.rc))
    np.testing.assert_array_equal(memory.rows, known.rows)


def test_cells_of_a_fine_map_are_parts_of_the_coarse_ones(home: SeenHome) -> None:
    coarse = built(GridMapBuilder(home.encoder), home.frames[:8]).storeys[0].memory
    fine = built(GridMapBuilder(home.encoder, cell=0.25), home.frames[:8]).storeys[0].memory
    assert fine.grid == GridSpec(coarse.grid.origin_xz, 0.25, (200, 200))
    assert {tuple(rc) for rc in (fine.rc // 4).tolist()} == {tuple(rc) for rc in coarse.rc.tolist()}
    sums = CellSums(fine.dim)
    sums.add(fine.rc // 4, fine.rows, fine.weights)
    assert sums.cells()[2].sum() == pytest.approx(coarse.weights.sum(), rel=1e-5)


def test_the_vector_of_a_whole_picture_goes_to_exactly_the_cells_in_view(home: SeenHome) -> None:
    frame = home.frames[0]
    memory = built(GridMapBuilder(home.encoder, features="images"), [frame]).storeys[0].memory
    vector = home.encoder.encode_images([frame])[0]
    assert np.allclose(memory.rows, vector, atol=1e-6)
    offsets = memory.grid.xz_from_rc(memory.rc) - frame.T_world_camera[[0, 2], 3]
    heading = frame.T_world_camera[[0, 2], 2]
    assert len(offsets) >= 3
    assert (offsets @ heading > -0.75).all()
    assert (np.linalg.norm(offsets, axis=1) < 8).all()
    assert memory.weights.min() >= 0.25 - 1e-6
    assert memory.weights.max() <= 1 + 1e-6


def test_weights_add_up_over_views_vectors_stay_means_and_batches_change_nothing(home: SeenHome) -> None:
    once = built(GridMapBuilder(home.encoder), home.frames[:5]).storeys[0].memory
    twice = built(GridMapBuilder(home.encoder), home.frames[:5] * 2).storeys[0].memory
    assert np.allclose(twice.weights, 2 * once.weights, rtol=1e-5)
    assert np.allclose(twice.rows, once.rows, atol=1e-5)
    one, many = (
        built(GridMapBuilder(home.encoder, views=ViewOptions(batch=size)), home.frames[:7]) for size in (1, 64)
    )
    assert np.array_equal(one.storeys[0].memory.rows, many.storeys[0].memory.rows)


def test_instances_of_an_object_map_are_where_their_surfaces_are(home: SeenHome) -> None:
    captions = {thing.instance_id: f"the {thing.name}" for thing in home.scene.objects}
    builder = ObjectMapBuilder(home.encoder, InstanceIds(captions))
    assert "oracle-perception" in builder.name
    memory = built(builder, home.frames)
    found = {item.caption: (storey, item) for storey in memory.storeys for item in storey.memory.objects}
    by_name = {f"the {thing.name}": thing for thing in home.scene.objects}
    assert {captions[number] for number in home.well_seen} <= set(found)
    for caption, (storey, item) in found.items():
        thing = by_name[caption]
        low, high = np.array(thing.centre) - np.array(thing.size) / 2, np.array(thing.centre) + np.array(thing.size) / 2
        assert (item.points >= low - NEAR).all(), caption
        assert (item.points <= high + NEAR).all(), caption
        assert storey is min(memory.storeys, key=lambda one: abs(one.floor_y + 1.2 - thing.centre[1]))
        assert int(np.argmax(item.feature)) == thing.instance_id


def test_masks_without_identity_are_merged_into_objects_by_overlap_and_feature(home: SeenHome) -> None:
    class Anonymous(InstanceIds):
        name = "anonymous masks"

        def segment(self, frame: Frame) -> Segments:
            return Segments(super().segment(frame).masks)

    memory = built(ObjectMapBuilder(home.encoder, Anonymous()), home.frames)
    numbers = [int(np.argmax(item.feature)) for storey in memory.storeys for item in storey.memory.objects]
    assert len(set(numbers)) >= 0.9 * len(home.well_seen)
    assert len(numbers) <= 1.35 * len(set(numbers))  # sides of a large object that share no points stay apart


def test_depth_regions_find_most_objects_without_any_model(home: SeenHome) -> None:
    floors = home.scene.navigation.storey_heights
    some = SeenHome(home.scene, home.frames[::2])
    memory = built(
        ObjectMapBuilder(home.encoder, DepthRegions(floors=floors), views=ViewOptions(floors=floors)), some.frames
    )
    by_id = {thing.instance_id: thing for thing in home.scene.objects}
    found = set()
    for storey in memory.storeys:
        assert isinstance(storey.memory, ObjectMap)
        for item in storey.memory.objects:
            number = int(np.argmax(item.feature))
            if np.hypot(*(np.array(item.centre) - by_id[number].centre)[[0, 2]]) < 0.7:
                found.add(number)
    assert len(some.well_seen) >= 15
    assert len(found & some.well_seen) >= 0.7 * len(some.well_seen)


def test_the_same_views_stored_as_a_robot_recording_give_the_same_map(home: SeenHome, tmp_path: Path) -> None:
    frames = [replace(frame, ids=None) for frame in home.frames[:12]]
    write_recording(tmp_path / "run", frames, up="z", colour="jpg")
    recorded, counts = read_robot_frames(tmp_path / "run", up="z")
    assert (len(list(recorded)), counts.by_reason) == (12, {})
    floors = floors_of_frames(recorded.some(12))
    assert floors == pytest.approx(home.scene.navigation.storey_heights[:1], abs=0.03)
    direct, robot = (
        built(GridMapBuilder(ColourEncoder(), views=ViewOptions(floors=heights)), views).storeys[0]
        for heights, views in ((home.scene.navigation.storey_heights[:1], frames), (floors, recorded))
    )
    assert robot.memory.grid == direct.memory.grid
    one, other = (dict(zip(m.flat_index.tolist(), m.rows, strict=True)) for m in (robot.memory, direct.memory))
    assert len(one.keys() ^ other.keys()) <= 2  # rounding to mm moves a point across the edge of a cell
    cosines = [one[cell] @ other[cell] for cell in one.keys() & other.keys()]
    assert np.median(cosines) > 0.999
    assert np.mean(cosines) > 0.99
    assert (robot.occupancy.cells == direct.occupancy.cells).mean() > 0.999


def test_an_empty_builder_and_a_view_that_shows_nothing_map_nothing(home: SeenHome) -> None:
    for builder in (GridMapBuilder(IdEncoder(3)), ObjectMapBuilder(IdEncoder(3), InstanceIds())):
        memory = builder.finish()
        assert memory.storeys == ()
        assert memory.num_frames == 0
    blind = replace(home.frames[0], depth_m=np.zeros_like(home.frames[0].depth_m), ids=None)
    memory = built(GridMapBuilder(ColourEncoder()), [blind])
    assert len(memory.storeys[0].memory.rows) == 0
    assert (memory.storeys[0].occupancy.cells == UNKNOWN).all()


def test_bad_options_and_encoders_are_refused(home: SeenHome) -> None:
    encoder = home.encoder
    with pytest.raises(AgentError, match=r"cell is 0.3; expected 1 m divided by a whole number"):
        GridMapBuilder(encoder, cell=0.3)
    with pytest.raises(AgentError, match=r"floors are \[0.0, 1.0\]; expected at least one, each 1.5 m from the next"):
        ViewOptions(floors=(0.0, 1.0))

    class Pooled:
        name, dim = "pooled", 4

    with pytest.raises(AgentError, match="encoder 'pooled' has no encode_patches"):
        GridMapBuilder(Pooled())

    class Flat(IdEncoder):
        def encode_patches(self, frames):
            return super().encode_patches(frames).reshape(len(frames), -1, self.dim)

    with pytest.raises(AgentError, match=r"encode_patches gave an array of shape .*; expected finite numbers of shape"):
        built(GridMapBuilder(Flat(encoder.dim - 1)), home.frames[:1])
    with pytest.raises(AgentError, match="are outside of the 50 x 50 m around"):
        built(GridMapBuilder(encoder, views=ViewOptions(centre_xz=(90.0, 90.0))), home.frames[:3])
    with pytest.raises(AgentError, match="gave 2 masks and 1 captions"):
        Segments(np.zeros((2, 4, 4), bool), ("one",))
