"""Finds the dataset's episode that another program's file is about: from its fields, its name, or a declaration."""

from collections.abc import Callable
from pathlib import Path
from typing import cast

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError, RunFileError, short
from sim.types import SPLITS, EpisodeKey, Split

from .pose_tables import PoseTable


def find_episode(
    where: str, named: EpisodeKey, dataset: PersonalDataset, problem: Callable[[Episode], str | None]
) -> Episode:
    """The dataset's episode that a run names by its id or its place in the content file, and that starts where it does.

    Args:
        where: `file:line` for errors.
        named: The key in the file. habitat-lab replaces ids with places in the content file.
        dataset: The episodes.
        problem: Returns the difference between the run's start and an episode's, or None.

    Raises:
        RunFileError: There is no such episode, or the run does not begin at its start.
    """
    split, scene, episode_id = named
    if (split, scene) not in dataset.files:
        known = ", ".join(name for of_split, name in dataset.files if of_split == split) or "no scene"
        raise RunFileError(
            f"{where}: scene {scene!r} is not in split {split!r} of {dataset.root}; expected one of: "
            f"{known}. Give --dataset the episodes that were played."
        )
    try:
        episodes = list(dataset.episodes(splits=(split,), scenes=(scene,)))
    except DatasetError as error:
        raise RunFileError(f"{where}: its episode cannot be read: {error}") from None
    by_id = next((episode for episode in episodes if episode.key.episode_id == episode_id), None)
    if by_id and problem(by_id) is None:
        return by_id
    place = int(episode_id) if episode_id.isdecimal() else len(episodes)
    if place < len(episodes) and problem(episodes[place]) is None:
        return episodes[place]
    if by_id is None:
        raise RunFileError(
            f"{where}: found no episode {named} in {dataset.root}, and none in that place of its file that starts "
            "here; expected an id of the content file. Give --dataset the episodes that were played."
        )
    raise RunFileError(f"{where}: episode {named} {problem(by_id)}. Reset to the episode's start pose.")


def key_of_table(table: PoseTable, declared: EpisodeKey | None, dataset: PersonalDataset) -> EpisodeKey:
    """The episode of a pose file: from its fields, else the declared one, else from the file's name.

    Raises:
        RunFileError: No episode is named, or a field has an impossible value.
    """
    told = {name: table.facts[name] for name in ("split", "scene", "episode_id") if name in table.facts}
    if "episode" in table.facts:
        parts = str(table.facts["episode"]).split("/")
        if len(parts) == 3 and not told:
            told = dict(zip(("split", "scene", "episode_id"), parts, strict=True))
        else:
            told.setdefault("episode_id", table.facts["episode"])
    fallback = declared or _key_from_name(table.path, dataset)
    if len(told) < 3 and fallback is None:
        raise RunFileError(
            f"{table.where}: found {short(told) if told else 'nothing'} to name its episode; expected split, scene and "
            "episode_id. Give --episode SPLIT/SCENE/ID, name the file SPLIT-SCENE-ID, or add the fields."
        )
    rest = fallback._asdict() if fallback else {}
    split, scene, episode_id = (str(told.get(name, rest.get(name))) for name in ("split", "scene", "episode_id"))
    if split not in SPLITS:
        raise RunFileError(f"{table.where}: split is {split!r}; expected one of {', '.join(SPLITS)}. Correct it.")
    scene = scene.replace("\\", "/").rsplit("/", 1)[-1].split(".", 1)[0]
    return EpisodeKey(cast(Split, split), scene, episode_id.removesuffix(".0"))


def _key_from_name(path: Path, dataset: PersonalDataset) -> EpisodeKey | None:
    """The key in a file name `<split>-<scene>-<id>[-<participant>]`, for scenes and ids of the dataset only."""
    for split, scene in sorted(dataset.files, key=lambda key: -len(key[1])):
        before = f"{split}-{scene}-"
        if not path.stem.startswith(before):
            continue
        rest = path.stem.removeprefix(before)
        ids = {record.episode_id for record in dataset.content(split, scene).episodes}
        known = [one for one in ids if rest == one or rest.startswith(f"{one}-")]
        return EpisodeKey(split, scene, max(known, key=len) if known else rest)
    return None
