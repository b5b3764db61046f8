"""Oracle maps of a home's episodes, as good or as noisy as the settings say (oracle_map.py, noise.py)."""

from functools import lru_cache
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode

from .encoders.protocol import TextEncoder
from .maps.oracle_map import OracleHome, oracle_home
from .maps.oracle_noise import OracleVariant, other_texts, variant_map
from .settings import GroundSettings
from .types import FeatureMap


class OracleMaps:
    """Gives each episode of a scene the oracle map of its target's storey; each is made once."""

    def __init__(self, dataset: PersonalDataset, scene: str, settings: GroundSettings, encoder: TextEncoder) -> None:
        """Reads the scene's episode files; with clutter those of all scenes, whose texts it is drawn from.

        Raises:
            DatasetError: The scene is unknown or a file is damaged.
            SceneError: The home does not fit a map.
        """
        self._settings = settings
        self._encoder = encoder
        self._home = oracle_home(dataset, scene)
        self._variant = OracleVariant(
            blur=settings.blur,
            object_noise=settings.object_noise,
            cell_noise=settings.cell_noise,
            clutter=settings.clutter_texts,
            seed=settings.seed,
        )
        homes = _all_homes(dataset.root) if settings.clutter_texts else ()
        self._clutter_texts = other_texts(homes, scene)
        self._maps: dict[str | None, FeatureMap] = {}

    def memory(self, episode: Episode) -> FeatureMap:
        """The map of the target's storey, or of all storeys where the settings say so.

        Raises:
            SceneError: No text to draw clutter from.
        """
        floor_id = None if self._settings.all_storeys else episode.record.floor_id
        if floor_id not in self._maps:
            self._maps[floor_id] = variant_map(
                self._home,
                self._encoder,
                floor_id=floor_id,
                variant=self._variant,
                clutter_texts=self._clutter_texts,
            )
        return self._maps[floor_id]


@lru_cache(maxsize=1)
def _all_homes(root: Path) -> tuple[OracleHome, ...]:
    """All homes of a dataset; read once per process, because every scene draws its clutter from all the others."""
    dataset = PersonalDataset(root)
    return tuple(oracle_home(dataset, name) for name in dataset.scenes)
