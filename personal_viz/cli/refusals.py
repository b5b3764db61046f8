"""Checks options that several verbs share before any work is done; says in one line which place cannot be written."""

import re
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import SequenceSet
from sim.errors import DatasetError, PersonalVizError, line_from_validation_error
from sim.sequences.searches import sequence_key
from sim.tasks.run_files import RUN_ID
from sim.types import SPLITS, EpisodeKey, SceneKind, Split

_LEAST = {
    **dict.fromkeys(("limit", "jobs", "batch", "homes", "width", "height", "max_steps", "max_calls", "max_tokens"), 1),
    **dict.fromkeys(("failures", "seed", "sample_seed"), 0),
}
"""Smallest allowed value of an option, by field of a verb."""


def check_options(verb: object) -> None:
    """Refuses invalid values of `--run-id` and of the numbers that several verbs have, and evidence of no dataset.

    Raises:
        PersonalVizError: A value is invalid; the message names the option, the value and the expected values.
    """
    for name, least in _LEAST.items():
        value = getattr(verb, name, None)
        if isinstance(value, int) and value < least:
            raise PersonalVizError(
                f"--{name.replace('_', '-')} is {value}; expected a whole number from {least}. "
                "Leave it out for the default."
            )
    evidence = getattr(verb, "evidence", ())
    if evidence and not getattr(verb, "dataset", None):
        raise PersonalVizError(
            f"--evidence {evidence[0]}: found no --dataset; expected both, since evidence helps to recover a dataset's "
            "homes. Give --dataset, or leave --evidence out."
        )
    run_id = getattr(verb, "run_id", None)
    if run_id is not None and not re.fullmatch(RUN_ID, run_id):
        raise PersonalVizError(
            f"--run-id is {run_id!r}; expected 1 to 80 letters, digits, '.', '_' or '-', not starting with '.'. "
            "Give another, or leave it out; --out says in which folder."
        )


def sampled(
    episodes: PersonalDataset, *, splits: Sequence[Split], scenes: Sequence[str], limit: int | None, seed: int
) -> list[Episode]:
    """The episodes that `--split`, `--scene`, `--limit` and `--sample-seed` choose; no splits or scenes = all.

    Raises:
        PersonalVizError: They hold no episode.
        DatasetError: As `PersonalDataset.sample`.
    """
    chosen = episodes.sample(splits=tuple(splits) or SPLITS, scenes=tuple(scenes) or None, per_split=limit, seed=seed)
    if not chosen:
        raise nothing_chosen(episodes.root)
    return chosen


def sampled_sequences(
    root: Path, *, splits: Sequence[Split], scenes: Sequence[str], limit: int | None, seed: int
) -> list[EpisodeKey]:
    """The sequences of a set that the same options choose, named as in runs; the limit is that of a split.

    Raises:
        PersonalVizError: They hold no sequence.
        DatasetError: As `SequenceSet.sequences`.
    """
    found = [sequence_key(one) for one in SequenceSet(root).sequences(scenes=tuple(scenes) or None)]
    chosen: list[EpisodeKey] = []
    for split in splits or SPLITS:
        own = [key for key in found if key.split == split]
        if limit is not None:
            places = np.random.default_rng(seed).permutation(len(own))[:limit]
            own = [own[place] for place in sorted(places)]
        chosen += own
    if not chosen:
        raise nothing_chosen(root)
    return chosen


def require_dataset(dataset: Path | None) -> Path:
    """The folder of `--dataset`; raises PersonalVizError without one."""
    if dataset is None:
        raise PersonalVizError(
            "--dataset: found none; expected the folder of the episodes. Give it, or --study for those of a study."
        )
    return dataset


def require_none(verb: object, names: Sequence[str], *, beside: str) -> None:
    """Raises PersonalVizError where one of these options of a verb, by field, is given beside another one."""
    for name in names:
        if getattr(verb, name):
            option = f"--{name.replace('_', '-')}"
            raise PersonalVizError(f"{option} beside {beside}: expected one of them. Leave one out.")


def nothing_chosen(dataset: Path) -> PersonalVizError:
    """The error of splits and scenes without an episode."""
    return PersonalVizError(f"{dataset}: the chosen splits and scenes hold no episode; expected one. Choose others.")


def require_suffix(option: str, path: Path, suffix: str) -> None:
    """Refuses a file name with the wrong ending.

    Args:
        option: The option as typed, such as `--out`.
        path: The option's value.
        suffix: The required ending, such as `.rrd`, in upper or lower case.

    Raises:
        PersonalVizError: The ending is wrong; the message names the option.
    """
    if path.suffix.lower() != suffix:
        raise PersonalVizError(f"{option} is {str(path)!r}; expected a file that ends in {suffix}. Give another name.")


@contextmanager
def writing(place: Path, options: str = "--out") -> Iterator[None]:
    """Turns an OSError in a block that writes into a one-line error.

    Args:
        place: The file or folder that the options name.
        options: The options that can name another place.

    Raises:
        PersonalVizError: A file or folder cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise PersonalVizError(
            f"{place}: cannot be written ({error.strerror}); expected a folder in which you can write. "
            f"Give another {options}."
        ) from None


def require_folder(folder: Path, options: str = "--out") -> None:
    """Makes the folder and checks that it can be written.

    Raises:
        PersonalVizError: The folder cannot be made or written.
    """
    with writing(folder, options):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def line_from_refused_options(verb: str, options: Mapping[str, object], error: ValidationError) -> str:
    """One line about a value that no file or run may hold, with the option that it came from.

    Args:
        verb: The verb as typed, for values that were made from several options.
        options: Values by field name of the verb.
        error: The error that pydantic raised.
    """
    first = error.errors()[0]
    same_name = [name for name in options if name == (first["loc"] or ("",))[-1]]
    same_value = [name for name, value in options.items() if value is not None and str(value) == str(first["input"])]
    both = [name for name in same_name if name in same_value]
    for name in (
        *both,
        *same_value,
        *same_name,
    ):  # a field may share its name with another option: the study's name, its folder
        option = f"--{name.replace('_', '-')}"
        return line_from_validation_error(option, error, advice=f"Give another {option}.")
    advice = "Change the options; where they are as they should be, please report this line with your command."
    return line_from_validation_error(f"{verb}, {error.title}", error, advice=advice)


def require_no_scan(kind: SceneKind, *, clutter: int) -> None:
    """Refuses clutter in scans, which have their own.

    Args:
        kind: Kind of the homes that are opened.
        clutter: The option `--clutter`.

    Raises:
        PersonalVizError: Both scans and clutter are asked for.
    """
    if clutter and kind == "scan":
        raise PersonalVizError(
            f"--clutter is {clutter} beside --scenes-dir; expected 0 in scans. Leave one of the two out."
        )


def require_same_dataset(dataset: PersonalDataset, digests: Collection[str], *, whose: str) -> None:
    """Refuses a dataset other than the one that a study or a run was made from.

    Args:
        dataset: The dataset of `--dataset`.
        digests: Digests of the datasets that were used; there must be no other than this dataset's.
        whose: Says what they belong to, such as `the study's`.

    Raises:
        DatasetError: The digests differ.
    """
    if set(digests) != {dataset.digest()}:
        expected = " and ".join(sorted(digest[:12] for digest in digests))
        raise DatasetError(
            f"--dataset {dataset.root}: has digest {dataset.digest()[:12]}; expected {expected}, {whose}. Give the "
            "--dataset that was used then, with the same --evidence."
        )
