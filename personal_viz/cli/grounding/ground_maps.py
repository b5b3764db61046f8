"""Reads layout and cells of the files of `ground --map PATH` from their headers; options must agree with them."""

from collections.abc import Sequence
from pathlib import Path

from grounding.evaluation.settings import CELLS, MapLayout
from grounding.maps.files import read_map_header
from grounding.methods.by_name import takes_objects
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, RunFileError

_KINDS = {True: "maps of objects", False: "grid maps"}


def layout_of_maps(
    folder: Path, dataset: PersonalDataset, *, scenes: Sequence[str], method: str, asked: MapLayout | None
) -> MapLayout:
    """The layout of the chosen scenes' map files; grid maps with cells of no layout (`cell_of_maps`) are `grid`.

    Args:
        folder: Folder of `<Scene>.npz`.
        dataset: The episodes' dataset.
        scenes: The chosen scenes; empty = all scenes of the dataset.
        method: The method; it must take maps of this layout.
        asked: The option --layout; None = not given.

    Raises:
        DatasetError: A scene is unknown.
        RunFileError: A file is missing or damaged, or two have different layouts or cells.
        AgentError: The layout differs from `asked`, or does not suit the method.
    """
    cell = cell_of_maps(folder, dataset, scenes=scenes)
    layout: MapLayout = "objects" if cell is None else "fine" if cell == CELLS["fine"] else "grid"
    if asked is not None and asked != layout:
        raise AgentError(
            f"--layout is {asked!r} with --map {folder}; expected {layout!r}, as its files say. Leave --layout out."
        )
    has_objects, wants_objects = layout == "objects", takes_objects(method)
    if has_objects != wants_objects:
        raise AgentError(
            f"--map {folder}: holds {_KINDS[has_objects]} with --method {method}; expected {_KINDS[wants_objects]}. "
            "Give another --method, or other maps."
        )
    return layout


def cell_of_maps(folder: Path, dataset: PersonalDataset, *, scenes: Sequence[str]) -> float | None:
    """Side of the cells in the chosen scenes' map files, metres; None for maps of objects.

    Raises:
        DatasetError: A scene is unknown.
        RunFileError: A file is missing or damaged, or two have different layouts or cells.
    """
    cells: dict[float | None, Path] = {}
    for scene in scenes or dataset.scenes:
        dataset.require_scene(scene)
        path = folder / f"{scene}.npz"
        first = read_map_header(path).storeys[0].grid
        cells.setdefault(None if first is None else first.cell, path)
    if len(cells) > 1:
        (one, path), (other, other_path) = list(cells.items())[:2]
        raise RunFileError(
            f"{other_path}: has {_words(other)}, {path.name} has {_words(one)}; expected the same in all chosen "
            "scenes. Ground them apart with --scene."
        )
    return next(iter(cells))


def _words(cell: float | None) -> str:
    return "objects" if cell is None else f"cells of {cell:g} m"
