"""Makes an edition: episodes of annotated scenes, checked before anything is written, and a record of their origin.

Folder with annotations or episodes -> homes -> searches -> files; `personal-viz generate` is its verb.
"""

import hashlib
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from sim.errors import DatasetError, line_from_validation_error
from sim.homes.open_home import home_plan, open_scene, open_unasked_scan, scene_from_plan
from sim.homes.plan import HomePlan
from sim.mesh import Scene
from sim.types import SPLITS, Split

from ..episodes.dataset import PersonalDataset
from ..episodes.schema import EpisodeRecord
from ..episodes.validate import validate_dataset
from .annotated import AnnotatedHome, home_from_annotations, home_from_edition
from .annotations import Change, annotated_scenes, annotation_path, changes_since, fold, read_edits
from .change_list import change_files
from .content import content_file, index_file, packed, packed_for_habitat, write_files
from .refinement import asked_objects, read_opinions
from .searches import Starts, Style, draw_searches

RECORD = "generated.json"
HABITAT = "objectnav"
"""Folder of the copy for habitat-lab's stock class."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class SceneSource(BaseModel):
    """What the episodes of one scene were made from."""

    model_config = _MODEL
    num_edits: int | None
    """Edits of its annotations at that time; later ones are in `changes_since`. None = made from episodes."""
    digest: str
    """sha256 of the annotations' edits, or of the scene's files in the edition."""
    scene_digest: str
    """`Scene.digest` of the home."""
    num_objects: int
    """Objects that episodes could ask for."""
    left_out: tuple[str, ...]
    """The other objects, each with the reason."""


class Generated(BaseModel):
    """`generated.json`: the origin of an edition."""

    model_config = _MODEL
    version: Literal[1] = 1
    seed: int
    starts: Starts
    counts: dict[Split, int]
    """Episodes of each split in each scene."""
    descriptions: dict[str, int]
    """Number of descriptions by the way they were written, and of answers that were refused."""
    scenes: dict[str, SceneSource]


@dataclass(frozen=True, slots=True)
class Edition:
    """Drawn episodes of several scenes."""

    homes: Mapping[str, AnnotatedHome]
    episodes: Mapping[tuple[Split, str], tuple[EpisodeRecord, ...]]
    """By split and scene; only where there are some."""
    sources: Mapping[str, SceneSource]
    changes: Mapping[str, tuple[Change, ...]]
    """Objects of each scene that differ from those of the edition before."""


class OpenedHome(NamedTuple):
    """A home with its words, and what it was made from."""

    home: AnnotatedHome
    source: SceneSource
    changes: tuple[Change, ...]
    """Objects that changed since the edition before."""
    scene: Scene
    plan: HomePlan | None
    """The plan that the scene was made from; None for scans."""


def scenes_to_ask(dataset: Path) -> tuple[str, ...]:
    """The scenes with annotations; where there are none, those with episodes.

    Raises:
        DatasetError: The folder holds neither.
    """
    return annotated_scenes(dataset) or PersonalDataset(dataset).scenes


def require_free(
    out: Path, dataset: Path, scenes: Iterable[str], counts: Mapping[Split, int], *, replace: bool
) -> None:
    """Refuses to write an edition where episodes stand that it would overwrite, or that would stay beside it.

    Args:
        out: Folder of the new edition.
        dataset: Folder that it is made from.
        scenes: Its scenes.
        counts: Its episodes of each split.
        replace: Whether episodes of the same split and scene may be overwritten.

    Raises:
        DatasetError: It would; the message says which file.
    """
    new = {(split, scene) for split in SPLITS if counts.get(split, 0) for scene in scenes}
    if not new:
        raise DatasetError(f"{out}: 0 episodes are asked for; expected some. Give --easy, --medium or --hard.")
    sources = {scene for scene in scenes if scene not in annotated_scenes(dataset)}
    for split in SPLITS:
        for path in sorted((out / split / "content").glob("*.json*")):
            scene = path.name.split(".")[0]
            if (split, scene) not in new:
                raise DatasetError(
                    f"{path}: found episodes that the new edition does not have; expected a folder of its own, because "
                    "editions are never mixed. Give another --out, or remove the file."
                )
            if scene in sources and out.resolve() == dataset.resolve():
                raise DatasetError(
                    f"{path}: found the episodes from which new ones are made; expected another folder. Give --out."
                )
            if not replace:
                raise DatasetError(
                    f"{path}: found episodes; expected none. Give another --out, or --replace to overwrite them."
                )


def edits_before(*folders: Path) -> dict[str, int]:
    """The number of edits that each scene's last edition was made from, read in the first folder that has one.

    Raises:
        DatasetError: Its record is damaged.
    """
    path = next((folder / RECORD for folder in folders if (folder / RECORD).is_file()), None)
    if path is None:
        return {}
    try:
        made = Generated.model_validate_json(path.read_bytes())
    except ValidationError as error:
        advice = "Restore the file, or remove it: then all objects count as changed."
        raise DatasetError(line_from_validation_error(str(path), error, advice=advice)) from None
    return {scene: source.num_edits or 0 for scene, source in made.scenes.items()}


def draw_edition(
    dataset: Path,
    scenes: Sequence[str],
    *,
    scenes_dir: Path | None,
    counts: Mapping[Split, int],
    seed: int,
    style: Style,
    before: Mapping[str, int] = MappingProxyType({}),
    refined: Path | None = None,
    on_scene: Callable[[str], None] = lambda scene: None,
) -> Edition:
    """Draws the episodes of each scene; a scene's episodes depend on its name and the seed, not on the other scenes.

    Args:
        dataset: Folder with `annotations/<Scene>.jsonl`, or with an edition whose objects get new owners.
        scenes: Names of the scenes.
        scenes_dir: Folder of scans; None = homes made from the edition's plans or episodes.
        counts: Episodes of each split, in each scene.
        seed: The seed.
        style: Starts and descriptions.
        before: Number of edits of each scene that the edition before was made from, as `edits_before` reads it.
        refined: Folder of opinions on the captions of an edition; those that are accepted replace the edition's.
        on_scene: Called after each scene.

    Raises:
        DatasetError: A scene is unknown, its annotations are damaged, or a split's constraint cannot be met.
        SceneError: A scene cannot be opened.
    """
    homes: dict[str, AnnotatedHome] = {}
    sources: dict[str, SceneSource] = {}
    episodes: dict[tuple[Split, str], tuple[EpisodeRecord, ...]] = {}
    changes: dict[str, tuple[Change, ...]] = {}
    for scene in scenes:
        opened = opened_home(dataset, scene, scenes_dir, num_before=before.get(scene, 0), refined=refined)
        homes[scene], sources[scene], changes[scene] = opened.home, opened.source, opened.changes
        own = int.from_bytes(hashlib.sha256(scene.encode()).digest()[:8])
        drawn = draw_searches(homes[scene], counts, rng=np.random.default_rng([seed, own]), style=style)
        episodes |= {(split, scene): found for split, found in drawn.items() if found}
        on_scene(scene)
    return Edition(homes, episodes, sources, changes)


def edition_files(edition: Edition, made: Generated) -> dict[str, bytes]:
    """All files of an edition by path: as released, the copy for Habitat's own class, its origin, and its changes."""
    categories = sorted({t.goal.object_category for home in edition.homes.values() for t in home.things.values()})
    files: dict[str, bytes] = {}
    for (split, scene), records in edition.episodes.items():
        content = content_file(edition.homes[scene], records, categories)
        for root, pack in (("", packed), (f"{HABITAT}/", packed_for_habitat)):
            files[f"{root}{split}/content/{scene}.json.gz"] = pack(content)
            files[f"{root}{split}/{split}.json.gz"] = pack(index_file(categories))
    files |= change_files(edition.changes)
    files[RECORD] = (made.model_dump_json(indent=2) + "\n").encode()
    return files


def write_edition(out: Path, files: dict[str, bytes]) -> None:
    """Writes an edition in which `validate` finds neither errors nor defects; otherwise writes nothing.

    Raises:
        DatasetError: `validate` finds something, or a file cannot be written.
    """
    with tempfile.TemporaryDirectory() as beside:
        write_files(Path(beside), files)
        report = validate_dataset(Path(beside))
    for check in report.checks:
        if check.level != "note" and check.measure.count:
            names = ", ".join(check.measure.names[:3])
            raise DatasetError(
                f"{out}: validate finds {check.measure.slug} (row {check.row}: {check.title}) in {names}; expected "
                "nothing, so nothing was written. Reword the captions of these objects, or take another --seed."
            )
    write_files(out, files)


def opened_home(
    dataset: Path, scene: str, scenes_dir: Path | None, *, num_before: int = 0, refined: Path | None = None
) -> OpenedHome:
    """The scene's home with its words; arguments as in `draw_edition`.

    Raises:
        DatasetError: The scene is unknown, or its annotations or episodes are damaged.
        SceneError: The scene cannot be opened.
    """
    plan = None
    path = annotation_path(dataset, scene)
    edits = read_edits(path)
    if edits:
        if refined is not None:
            raise DatasetError(
                f"{path}: annotates a scan, beside which refined captions ({refined}) mean nothing; expected an "
                "edition. Leave --captions out, or give the edition that was refined."
            )
        if scenes_dir is None:
            raise DatasetError(
                f"{path}: annotates a scan, but no folder of scans is given; expected the scan. Give --scenes-dir."
            )
        opened, scene_id = open_unasked_scan(scene, scenes_dir)
        home = home_from_annotations(opened, list(fold(edits).values()), scene_id=scene_id)
        digest = hashlib.sha256("\n".join(edit.model_dump_json() for edit in edits).encode()).hexdigest()
        changes = changes_since(edits, num_before)
    else:
        episodes = PersonalDataset(dataset)
        changes = _refinements(episodes, scene, refined) if refined is not None else ()
        if scenes_dir is None:
            plan = home_plan(episodes, scene)
        opened = open_scene(episodes, scene, scenes_dir=scenes_dir) if plan is None else scene_from_plan(plan)
        words = {change.id: change.after for change in changes if change.after is not None}
        home = home_from_edition(episodes, opened, refined=words)
        digest = episodes.scene_digest(scene)
    source = SceneSource(
        num_edits=len(edits) or None,
        digest=digest,
        scene_digest=opened.digest,
        num_objects=len(home.things),
        left_out=home.left_out,
    )
    return OpenedHome(home, source, changes, opened, plan)


def _refinements(episodes: PersonalDataset, scene: str, refined: Path) -> tuple[Change, ...]:
    """The accepted changes of a scene's captions."""
    opinions = read_opinions(refined, scene, asked_objects(episodes, scene)).values()
    return tuple(change for one in opinions if (change := one.change) is not None)
