"""The map for each episode: an oracle map, or a map from walks through the home.

A home is explored, mapped and saved once, and its map is read from then on.

Exploration (explore.py, an agent's observations only) -> views on its way -> map builder with an encoder -> a file per
scene. For oracle perception the views are rendered again with instance ids; the encoder's name says so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import RunFileError, SceneError
from sim.mesh import Scene
from sim.types import Camera

from ..agents.progress_notes import Say, scene_note
from ..encoders.by_name import encoder_called, make_encoder, make_image_encoder, sees
from ..encoders.protocol import ORACLE_SUFFIX, ModelOptions, TextEncoder
from ..maps.files import MapSource, load_memory, read_map_header, save_memory
from ..maps.home_map import HomeMemory, Memory, merged_storeys
from ..maps.oracle_map import OracleHome, oracle_home
from ..maps.oracle_noise import OracleVariant, other_texts, variant_map
from ..perception.oracle_perception import OraclePerception, PerceptionOptions
from ..types import FeatureMap
from .settings import CELLS, GroundSettings

if TYPE_CHECKING:
    from ..agents.explore import Exploration
    from ..encoders.protocol import DenseEncoder
    from ..maps.grid_map import MapBuilder
    from ..perception.segments import ViewSegmenter
    from .known_home import KnownHome

MAP_VERSION = 1
"""Increase it with every change to these maps; maps with another number are made again."""
VIEWS_EVERY = 2
"""Every second view of an exploration is mapped: views in a row differ by 30 of the 79 degrees in view, or by 25 cm."""


@dataclass(frozen=True, slots=True)
class MapFolders:
    """Folders of map files."""

    maps: Path
    """Folder of `<scene>.npz`; with `--map explore` the maps are written here."""
    explorations: Path
    """Folder of the explorations, which maps of all encoders share."""
    scenes_dir: Path | None = None
    """Folder of scans; None = the dataset's plans, or schematic homes."""
    notes: Path | None = None
    """Folder of notes on the present work in each scene, for a progress bar; None = no notes."""
    swept: tuple[tuple[GroundSettings, Path], ...] = ()
    """Other settings whose maps are made from the same rendered views, and their folders of map files."""

    def map_file(self, scene: str) -> Path:
        """The map of one scene."""
        return self.maps / f"{scene}.npz"


def oracle_maps(
    dataset: PersonalDataset, scene: str, settings: GroundSettings, encoder: TextEncoder
) -> Callable[[Episode], Memory]:
    """Gives each episode of a scene the oracle map of its target's storey; each map is made once.

    Reads the scene's episode files; with clutter those of all scenes, since clutter is drawn from their texts.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit a map, or (when called) there is no text to draw clutter from.
    """
    home = oracle_home(dataset, scene)
    variant = OracleVariant(
        blur=settings.blur,
        object_noise=settings.object_noise,
        cell_noise=settings.cell_noise,
        clutter=settings.clutter_texts,
        seed=settings.seed,
    )
    texts = other_texts(_all_homes(dataset.root) if settings.clutter_texts else (), scene)

    @cache
    def of_storey(floor_id: str | None) -> FeatureMap:
        return variant_map(home, encoder, floor_id=floor_id, variant=variant, clutter_texts=texts)

    return lambda episode: of_storey(None if settings.all_storeys else episode.record.floor_id)


@lru_cache(maxsize=1)
def _all_homes(root: Path) -> tuple[OracleHome, ...]:
    """All homes of a dataset; read once per process, because every scene draws its clutter from all the others."""
    dataset = PersonalDataset(root)
    return tuple(oracle_home(dataset, name) for name in dataset.scenes)


def home_maps(
    dataset: PersonalDataset,
    scene: str,
    settings: GroundSettings,
    folders: MapFolders,
    *,
    encoder: TextEncoder,
    model: ModelOptions,
) -> Callable[[Episode], Memory]:
    """Gives each episode of a scene the map of the storey on which it starts.

    The home's file is read, or made by walking the home, when the first map is needed. Its encoder must be that of the
    queries, `encoder`.

    Returns:
        A function that raises SceneError if the home cannot be opened, RunFileError if a map is missing or damaged or
        cannot be written, and AgentError if it was made with another encoder or holds no storey.
    """

    @cache
    def home() -> HomeMemory:
        path = folders.map_file(scene)
        if settings.map == "explore" and not path.exists():
            with scene_note(folders.notes, scene) as say:
                make_home_map(dataset, scene, settings, folders, model=model, say=say)
        require_map_of(path, scene)
        return load_memory(path, encoder=encoder)

    @cache
    def merged() -> Memory:
        return merged_storeys(home())

    return lambda episode: merged() if settings.all_storeys else home().storey_near(episode.start.position[1]).memory


def make_home_map(
    dataset: PersonalDataset,
    scene_name: str,
    settings: GroundSettings,
    folders: MapFolders,
    *,
    model: ModelOptions,
    say: Say,
) -> None:
    """Explores every storey of the home on which episodes start, unless that was done before, and saves its map.

    The maps of `folders.swept` that are missing are made too, so that a sweep renders each view once. They differ from
    `settings` in the errors of perception alone.

    Raises:
        SceneError: The home cannot be opened.
        RunFileError: A file is damaged or cannot be written.
        AgentError: The encoder cannot be loaded.
    """
    from sim.homes.open_home import open_scene

    from .known_home import home_of_dataset

    scene = open_scene(dataset, scene_name, scenes_dir=folders.scenes_dir, clutter=settings.home_clutter)
    home = home_of_dataset(dataset, scene, level=settings.paraphrase, seed=settings.seed)
    told = say if folders.notes is not None else None  # reporting steps costs the explorer some time
    beside = [
        (home_of_dataset(dataset, scene, level=other.paraphrase, seed=other.seed), other, replace(folders, maps=maps))
        for other, maps in folders.swept
        if not (maps / folders.map_file(scene_name).name).exists()
    ]
    map_home(home, settings, folders, model=model, say=say, say_steps=told, beside=beside)


def map_home(
    home: "KnownHome",
    settings: GroundSettings,
    folders: MapFolders,
    *,
    model: ModelOptions,
    say: Say,
    say_steps: Say | None = None,
    beside: "Sequence[tuple[KnownHome, GroundSettings, MapFolders]]" = (),
) -> None:
    """Explores a home's storeys, unless that was done before, and saves the map of the views.

    Each view is rendered once for this map and those of the same home `beside` it.

    Raises:
        SceneError: A storey has no place to start from, or oracle perception knows no object of the home.
        RunFileError: A file is damaged or cannot be written.
        AgentError: The encoder cannot be loaded.
    """
    from ..agents.explored_storeys import storey_explorations

    scene, wanted = home.scene, [(home, settings, folders), *beside]
    builders = [_builder(known, its_settings, model) for known, its_settings, _ in wanted]
    explorations = storey_explorations(
        scene, home.storeys, folder=folders.explorations, seed=settings.seed, say=say_steps
    )
    total, done = sum(ceil(len(walk.steps) / VIEWS_EVERY) for walk in explorations), 0
    for exploration in explorations:
        for frame in home.frames(exploration, camera=Camera(), every=VIEWS_EVERY):
            for builder in builders:
                builder.add(frame)
            done += 1
            say(f"mapping {done} of {total} views")
    for builder, (_, its_settings, its_folders) in zip(builders, wanted, strict=True):
        source = MapSource(
            scene=scene.name,
            kind=scene.kind,
            digest=scene.digest,
            builder=f"{builder.name} by {encoder_called(its_settings.map_encoder)}",
        )
        save_memory(its_folders.map_file(scene.name), builder.finish(), source)


def require_perceived(home: "KnownHome", settings: GroundSettings) -> None:
    """Refuses a home without known objects where the encoder sees none.

    Raises:
        SceneError: Neither semantics nor annotations say what is in the home.
    """
    if not (home.texts or sees(settings.encoder)):
        raise SceneError(
            f"{home.scene.name}: found no semantics and no annotations with encoder {settings.encoder!r}, which reads "
            "the names of objects; expected some, or a model that sees. Annotate the scan and give --dataset, or give "
            "--encoder clip:MODEL."
        )


def require_map_of(path: Path, scene: str) -> None:
    """Refuses a map file of another place than its name says.

    Raises:
        RunFileError: The file is missing or damaged, or its header names another place.
    """
    source = read_map_header(path).source
    if source.scene == scene:
        return
    if source.kind == "robot":
        advice = f"Make it again with personal-viz map --scene {scene} if it was recorded there."
    else:
        advice = f"Name it {source.scene}.npz, and put the map of {scene} here."
    raise RunFileError(
        f"{path}: says that it is of {source.scene!r}; expected {scene!r}, as its file is named. {advice}"
    )


def build_map(
    dataset: PersonalDataset,
    home: Scene,
    walks: "Sequence[Exploration]",
    *,
    encoder: str = "hashed",
    camera: Camera = Camera(),  # noqa: B008 - frozen value
) -> HomeMemory:
    """A map of a home from the views on walks through it, in cells of 1 m.

    Args:
        dataset: Dataset of the home; `hashed` and `minilm` use oracle perception with the captions of its episodes.
        walks: Results of `explore` in this home.
        encoder: An `EncoderName`.

    Raises:
        SceneError: A walk was made in another home.
        AgentError: The encoder is unknown or cannot be loaded.
    """
    from .known_home import home_of_dataset

    known = home_of_dataset(dataset, home)
    builder = _builder(known, GroundSettings("joint", map="explore", encoder=encoder), ModelOptions())
    for walk in walks:
        for frame in known.frames(walk, camera=camera, every=VIEWS_EVERY):
            builder.add(frame)
    return builder.finish()


def _builder(home: "KnownHome", settings: GroundSettings, model: ModelOptions) -> "MapBuilder":
    from ..maps.grid_map import GridMapBuilder
    from ..maps.storeys import ViewOptions

    encoder = _image_encoder(home, settings, model)
    # the same cells as the home's oracle map
    views = ViewOptions(centre_xz=home.centre_xz, batch=model.batch_size)
    if settings.layout == "objects":
        from ..maps.object_map import ObjectMapBuilder

        return ObjectMapBuilder(encoder, _segmenter(home, encoder), views=views)
    return GridMapBuilder(encoder, cell=CELLS[settings.layout], features=settings.features, views=views)


def _segmenter(home: "KnownHome", encoder: "DenseEncoder") -> "ViewSegmenter":
    """Instance ids; for a bare scan, whose faces have none, connected regions of depth."""
    from ..perception.segment_depth import DepthRegions
    from ..perception.segments import InstanceIds

    if not home.texts:
        return DepthRegions(floors=tuple(home.scene.navigation.storey_heights))
    # captions as perceived, with confusions; a real encoder gives no names
    return InstanceIds(encoder.perceived if isinstance(encoder, OraclePerception) else None)


def _image_encoder(home: "KnownHome", settings: GroundSettings, model: ModelOptions) -> "DenseEncoder":
    if sees(settings.encoder):
        return make_image_encoder(settings.encoder, options=model)
    require_perceived(home, settings)
    options = PerceptionOptions(
        view_noise=settings.view_noise,
        object_noise=settings.object_noise,
        confusion=settings.confusion,
        background="clutter" if settings.background else "empty",
        seed=settings.seed,
    )
    return OraclePerception(
        make_encoder(settings.encoder.removesuffix(ORACLE_SUFFIX)), home.texts, options=options, home=home.scene.name
    )
