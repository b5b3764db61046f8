"""The text of each object of a scene, from the episode files, for oracle perception.

This is ground truth: it enters a map only through `oracle_perception.OraclePerception`, and the map says so.
"""

from sim.episodes.dataset import PersonalDataset
from sim.mesh import Scene

from ..perception.paraphrase import ParaphraseLevel, paraphrase
from .oracle_map import oracle_home


def object_texts(
    dataset: PersonalDataset, scene: Scene, *, level: ParaphraseLevel = 0, seed: int = 0
) -> dict[int, str]:
    """Instance id to text: the caption of an episode that targets the object, else its category.

    Args:
        dataset: The scene's episodes.
        scene: Holds the objects; furniture that is in no episode (clutter) gets its category too.
        level: How far the captions are from the annotators' words; see `paraphrase`.
        seed: Seed of the paraphrases.

    Raises:
        DatasetError: The scene is unknown or a file is damaged.
        SceneError: The home does not fit an oracle map.
    """
    captions = {item.name: item.text for item in oracle_home(dataset, scene.name).objects}
    return {
        item.instance_id: paraphrase(captions.get(item.name, item.category), item.category, level=level, seed=seed)
        for item in scene.objects
    }
