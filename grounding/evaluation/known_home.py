"""A home and its objects, as oracle perception knows them: from episodes, from semantics, or from annotations.

A scene of a dataset, or a file of a scan -> `KnownHome` -> the views of its explorations -> a map (home_maps.py).
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sim.authoring.annotations import AnnotatedObject, annotated_scenes, annotation_path, fold, read_edits
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError
from sim.mesh import Scene, SceneObject
from sim.scans.up_axis import Up
from sim.types import Camera, Frame

from ..agents.exploration import Exploration
from ..agents.explore import frames_of
from ..agents.explored_storeys import storeys_of_starts
from ..maps.oracle_map import object_texts, oracle_home
from ..maps.storeys import points_at
from ..perception.paraphrase import ParaphraseLevel, paraphrase

_NEAREST = 0.05
"""Corners nearer to the camera's plane than this (metres) have no place in the picture."""


@dataclass(frozen=True, slots=True)
class KnownHome:
    """A home, and the ground truth that maps of oracle perception are made from."""

    scene: Scene
    texts: Mapping[int, str]
    """Instance id to text: caption, else category."""
    boxes: tuple[SceneObject, ...] = ()
    """Objects that annotations know by their box alone: what the mesh has inside it shows them."""
    centre_xz: tuple[float, float] = (0.0, 0.0)
    """Middle of the map's grid, world metres."""
    storeys: tuple[int, ...] = ()
    """Storeys to explore: on which episodes start, or all."""

    @property
    def objects_digest(self) -> str:
        """Short sha256 of texts and boxes, which `Scene.digest` does not cover."""
        boxes = [(item.instance_id, item.centre, item.size) for item in self.boxes]
        return hashlib.sha256(json.dumps([sorted(self.texts.items()), boxes]).encode()).hexdigest()[:8]

    def frames(self, walk: Exploration, *, camera: Camera, every: int) -> Iterator[Frame]:
        """The views of an exploration, as `frames_of` gives them, with the ids of objects that are known by boxes.

        Raises:
            SceneError: The exploration was made in another home.
        """
        for frame in frames_of(self.scene, walk, camera=camera, every=every):
            yield replace(frame, ids=ids_of_boxes(frame, self.boxes)) if self.boxes else frame


def home_of_dataset(dataset: PersonalDataset, scene: Scene, *, level: ParaphraseLevel = 0, seed: int = 0) -> KnownHome:
    """The home of a dataset's scene; its folder may hold annotations too, as `generate` leaves them.

    Args:
        dataset: Its captions give the texts; without `level` 0 paraphrased ones.
        scene: The opened scene.
        level: As in `paraphrase`.
        seed: Of the paraphrases.

    Raises:
        DatasetError: The scene is unknown, or a file is damaged.
        SceneError: The home does not fit an oracle map.
    """
    home = KnownHome(
        scene,
        object_texts(dataset, scene, level=level, seed=seed),
        centre_xz=oracle_home(dataset, scene.name).centre_xz,
        storeys=storeys_of_starts(dataset, scene),
    )
    return _annotated(home, _annotations(dataset.root, scene.name), level=level, seed=seed)


def home_of_scan(path: Path, *, up: Up | None = None, annotations: Path | None = None) -> KnownHome:
    """The home of a scan's file, without episodes: objects of its semantics by their categories, and annotated ones.

    Args:
        path: As in `open_scan`.
        up: As in `open_scan`.
        annotations: Folder of `annotate`, with edits of this scan.

    Raises:
        SceneError: The scan cannot be opened.
        DatasetError: The folder has no annotations of the scan, or damaged ones.
    """
    from sim.homes.open_home import open_scan

    scene = open_scan(path, up=up)
    if annotations is not None and scene.name not in annotated_scenes(annotations):
        found = ", ".join(annotated_scenes(annotations)) or "none"
        raise DatasetError(
            f"{annotations}: found no annotations of {scene.name!r} (of: {found}); expected "
            f"{annotation_path(annotations, scene.name)}. Annotate {path.name}, or leave out --dataset."
        )
    vertices = scene.mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    home = KnownHome(
        scene,
        {item.instance_id: item.category for item in scene.objects},
        centre_xz=(float(middle[0]), float(middle[2])),
        storeys=tuple(range(len(scene.navigation.storey_heights))),
    )
    return home if annotations is None else _annotated(home, _annotations(annotations, scene.name))


def ids_of_boxes(frame: Frame, boxes: Sequence[SceneObject]) -> NDArray[np.int32]:
    """(H, W) ids of a view, with those of boxes where its surface lies inside; of several boxes the smallest counts.

    Args:
        frame: A view with instance ids, world frame.
        boxes: Objects whose boxes are along the world's axes.
    """
    ids = frame.instance_ids.copy()
    for item in sorted(boxes, key=lambda item: -np.prod(item.size)):
        rows, cols = _window(frame, item)
        rc = np.argwhere(frame.depth_m[rows, cols] > 0) + np.array((rows.start, cols.start))
        if len(rc):
            inside = rc[(np.abs(points_at(frame, rc) - item.centre) <= np.array(item.size) / 2).all(axis=1)]
            ids[inside[:, 0], inside[:, 1]] = item.instance_id
    return ids


def _window(frame: Frame, box: SceneObject) -> tuple[slice, slice]:
    """Rows and columns of a view that hold all pixels of a box; empty where it is out of view."""
    height, width = frame.depth_m.shape
    corners = np.array(box.centre) + (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * box.size
    T_camera_world = np.linalg.inv(frame.T_world_camera)
    x, y, depth = (corners @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]).T
    if (depth <= 0).all():
        return slice(0, 0), slice(0, 0)
    if (depth < _NEAREST).any():  # the camera is beside or in it
        return slice(0, height), slice(0, width)
    fx, fy, cx, cy = frame.camera.lens
    u, v = fx * x / depth + cx, fy * y / depth + cy
    row, last_row = np.clip([np.floor(v.min()), np.ceil(v.max())], 0, height).astype(int).tolist()
    col, last_col = np.clip([np.floor(u.min()), np.ceil(u.max())], 0, width).astype(int).tolist()
    return slice(row, last_row), slice(col, last_col)


def _annotations(root: Path, scene: str) -> Sequence[AnnotatedObject]:
    path = annotation_path(root, scene)
    return tuple(fold(read_edits(path), where=str(path)).values())


def _annotated(
    home: KnownHome, objects: Sequence[AnnotatedObject], *, level: ParaphraseLevel = 0, seed: int = 0
) -> KnownHome:
    """The home with the captions and boxes of annotations."""
    texts = {
        item.id: paraphrase(" ".join(item.captions) or item.category, item.category, level=level, seed=seed)
        for item in objects
    }
    boxes = tuple(
        SceneObject(item.id, f"{item.category}_{item.id}", item.category, item.box.centre, item.box.size)
        for item in objects
        if item.box is not None
    )
    known = dict(chain(home.texts.items(), texts.items()))
    return replace(home, texts=MappingProxyType(known), boxes=boxes)
