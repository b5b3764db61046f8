"""Finds the dataset's episode that another program's file is about: from its fields, its name, or a declaration.

A key names one episode (`find_episode`). Other programs write less: OneMap a running index, VLFM a number and a scene.
Such names stand for several episodes (`numbered_keys`), and `only_fitting` takes the one whose start the file shows.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, cast

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError, RunFileError, did_you_mean, short
from sim.types import SPLITS, EpisodeKey, Split

NumberedBy = Literal["id", "place", "onemap"]
"""What a number in a file counts: `id` = it is the dataset's id; `place` = the place in the scene's content file, which
habitat-lab uses instead of ids; `onemap` = the place in a whole split, its content files sorted by name regardless of
case, without episodes that have several targets (`load_PersONAL_episodes` of the authors' OneMap)."""


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
        known = [name for of_split, name in dataset.files if of_split == split]
        raise RunFileError(
            f"{where}: scene {scene!r} is not in split {split!r} of {dataset.root}; expected one of: "
            f"{', '.join(known) or 'no scene'}.{did_you_mean(scene, known)} Give --dataset the episodes that were "
            "played."
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


def key_of_facts(
    where: str, path: Path, facts: Mapping[str, object], declared: EpisodeKey | None, dataset: PersonalDataset
) -> EpisodeKey:
    """The episode of a file: from its fields, else the declared one, else from the file's name.

    Args:
        where: `file:line` for errors.
        path: The file.
        facts: Its fields `split`, `scene`, `episode_id` or `episode`, as far as it has them.
        declared: The episode that a person named.
        dataset: The episodes.

    Raises:
        RunFileError: No episode is named, or a field has an impossible value.
    """
    told = {name: facts[name] for name in ("split", "scene", "episode_id") if name in facts}
    if "episode" in facts:
        parts = str(facts["episode"]).split("/")
        if len(parts) == 3 and not told:
            told = dict(zip(("split", "scene", "episode_id"), parts, strict=True))
        else:
            told.setdefault("episode_id", facts["episode"])
    fallback = declared or _key_from_name(path, dataset)
    if len(told) < 3 and fallback is None:
        raise RunFileError(
            f"{where}: found {short(told) if told else 'nothing'} to name its episode; expected split, scene and "
            "episode_id. Give --episode SPLIT/SCENE/ID, name the file SPLIT-SCENE-ID, or add the fields."
        )
    rest = fallback._asdict() if fallback else {}
    split, scene, episode_id = (str(told.get(name, rest.get(name))) for name in ("split", "scene", "episode_id"))
    if split not in SPLITS:
        raise RunFileError(
            f"{where}: split is {split!r}; expected one of {', '.join(SPLITS)}.{did_you_mean(split, SPLITS)} "
            "Correct it."
        )
    return EpisodeKey(cast(Split, split), _scene_name(scene), episode_id.removesuffix(".0"))


def numbered_keys(
    path: Path,
    facts: Mapping[str, object],
    dataset: PersonalDataset,
    *,
    numbered_by: NumberedBy | None,
    splits: Sequence[Split],
) -> tuple[EpisodeKey, ...]:
    """The episodes that a file may be about whose name or fields give a number but no split; () for all other files.

    Args:
        path: The file: `..._N` as OneMap numbers its files, or `N_SCENE` as VLFM does.
        facts: Its fields `scene` and `episode_id`, which count more than the name.
        dataset: The episodes.
        numbered_by: What the number counts; None = an id or a place.
        splits: The splits that were played.
    """
    if numbered_by == "onemap":
        number = re.search(r"(?:^|_)(\d+)$", path.stem)
        orders = [_onemap_order(dataset, split) for split in splits] if number else []
        return tuple(order[int(number[1])] for order in orders if number and int(number[1]) < len(order))
    if _key_from_name(path, dataset) is not None:
        return ()
    named = re.fullmatch(r"(\d+)_([A-Za-z0-9_-]+)", path.stem)
    if "split" in facts or "episode" in facts or (named is None and not {"scene", "episode_id"} <= set(facts)):
        return ()
    scene = _scene_name(str(facts.get("scene", named and named[2])))
    number_text = str(facts.get("episode_id", named and named[1])).removesuffix(".0")
    keys: dict[EpisodeKey, None] = {}
    for split in splits:
        if (split, scene) not in dataset.files:
            continue
        ids = [record.episode_id for record in dataset.content(split, scene).episodes]
        found = [number_text] if numbered_by != "place" and number_text in ids else []
        if numbered_by != "id" and number_text.isdecimal() and int(number_text) < len(ids):
            found.append(ids[int(number_text)])
        keys |= dict.fromkeys(EpisodeKey(split, scene, episode_id) for episode_id in found)
    return tuple(keys)


def only_fitting(where: str, keys: Iterable[EpisodeKey], problem: Callable[[EpisodeKey], str | None]) -> EpisodeKey:
    """The one of several possible episodes that a file fits.

    Args:
        where: `file:line` for errors.
        keys: At least one possible episode.
        problem: Says why the file does not fit an episode, or returns None.

    Raises:
        RunFileError: None fits, or several do.
    """
    problems = {key: problem(key) for key in keys}
    fitting = [key for key, found in problems.items() if found is None]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise RunFileError(
            f"{where}: may be {' or '.join(map(str, fitting))}; expected one episode. "
            "Give --split, --numbered-by id or place, or a file name SPLIT-SCENE-ID."
        )
    (key, found), *others = problems.items()
    more = f" (nor does it fit {', '.join(str(other) for other, _ in others)})" if others else ""
    raise RunFileError(
        f"{where}: is not a run of {key}: {found}{more}; expected the start of the episode that its number means. "
        "Give --dataset the very episodes that were played."
    )


def _onemap_order(dataset: PersonalDataset, split: Split) -> list[EpisodeKey]:
    """Episodes of a split as OneMap counts them."""
    scenes = sorted((scene for of_split, scene in dataset.files if of_split == split), key=str.casefold)
    return [
        EpisodeKey(split, scene, record.episode_id)
        for scene in scenes
        for record in dataset.content(split, scene).episodes
        if isinstance(record.object_id, str)
    ]


def _scene_name(text: str) -> str:
    """The scene in a path such as `hm3d/val/00800-TEEsavR23oF/TEEsavR23oF.basis.glb`."""
    return text.replace("\\", "/").rsplit("/", 1)[-1].split(".", 1)[0]


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
