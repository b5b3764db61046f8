"""Shards: a run in N parts for job arrays. Each part has whole homes, and `joined_run` makes the whole run of them."""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from sim.errors import PersonalVizError, RunFileError
from sim.types import EpisodeKey

from .run_files import Answer, EpisodeRun, Run, RunInfo, fitting_run_id, read_run, read_run_info

Item = TypeVar("Item")
SHARDS = "shards"
"""Folder below `--out` of the shards' run folders: tables of `--out` do not count them beside the whole run."""
_RUN, _SHARD, _EPISODES, _OF = "shard_run", "shard", "shard_episodes", "shard_of"
"""Entries of a shard's config: name of the whole run, i/N, number of episodes, digest of the whole run's episodes."""
_OWN = {_SHARD, _EPISODES}
"""Those of them that differ between the shards of one run."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of `of` parts of a run; 1/1 is the whole run."""

    number: int = 1
    """From 1."""
    of: int = 1

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def homes(self, num_episodes: Mapping[str, int]) -> set[str]:
        """The homes of this shard: whole ones, so that a home is opened, explored and mapped once.

        The home with the most episodes goes first, each to the shard with the fewest until then. Nothing else decides:
        the same episodes give the same shards on every machine.

        Args:
            num_episodes: Number of episodes by home.

        Raises:
            PersonalVizError: There are more shards than homes.
        """
        if self.of > max(1, len(num_episodes)):
            raise PersonalVizError(
                f"--shard {self}: found {len(num_episodes)} homes; expected at most as many shards, because a shard "
                f"takes whole homes. Give --shard i/{len(num_episodes)} or fewer, and --jobs for more cores each."
            )
        shares: list[set[str]] = [set() for _ in range(self.of)]
        loads = [0] * self.of
        for name in sorted(num_episodes, key=lambda name: (-num_episodes[name], name)):
            lightest = loads.index(min(loads))
            shares[lightest].add(name)
            loads[lightest] += num_episodes[name]
        return shares[self.number - 1]

    def part(self, by_home: Mapping[str, Sequence[Item]]) -> dict[str, list[Item]]:
        """This shard's homes with their episodes; raises PersonalVizError as `homes`."""
        homes = self.homes({name: len(found) for name, found in by_home.items()})
        return {name: list(found) for name, found in by_home.items() if name in homes}

    def run_info(self, info: RunInfo, keys: Mapping[str, Sequence[EpisodeKey]]) -> RunInfo:
        """`run.json` of this shard of the run `info`, whose episodes are `keys` by home; a whole run keeps its own."""
        if self.of == 1:
            return info
        own = sum(map(len, self.part(keys).values()))
        config = {
            _SHARD: str(self),
            _EPISODES: own,
            _OF: _digest(key for found in keys.values() for key in found),
            _RUN: info.run_id,
        }
        name = fitting_run_id(f"{info.run_id}-shard-{self.number}-of-{self.of}")
        return info.model_copy(update={"run_id": name, "config": info.config | config})

    def folder(self, out: Path, info: RunInfo) -> Path:
        """The run folder of `run_info`."""
        return out / info.run_id if self.of == 1 else out / SHARDS / info.run_id


def shard_from_text(text: str | None) -> Shard:
    """The shard that `i/N` names; None = the whole run.

    Raises:
        PersonalVizError: The text has another form.
    """
    if text is None:
        return Shard()
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    shard = Shard(int(found[1]), int(found[2])) if found else Shard(0)
    if not 1 <= shard.number <= shard.of:
        raise PersonalVizError(
            f"--shard is {text!r}; expected i/N with i from 1 to N, such as 2/8. In a SLURM job array --array=1-8: "
            "--shard $SLURM_ARRAY_TASK_ID/8."
        )
    return shard


def shards_by_run(folders: Sequence[Path]) -> dict[str, list[Path]]:
    """The folders of shards by the name of their whole run.

    Raises:
        RunFileError: A folder holds no shard, or a damaged one.
    """
    found: dict[str, list[Path]] = {}
    for folder in folders:
        info = read_run_info(folder)
        if not _OWN | {_OF, _RUN} <= info.config.keys():
            raise RunFileError(f"{folder}: holds a whole run; expected one made with --shard. Leave it out.")
        found.setdefault(str(info.config[_RUN]), []).append(folder)
    return found


def joined_run(folders: Sequence[Path]) -> Run:
    """The run that the command without `--shard` makes, from the folders of all its shards.

    Homes are in order of their names, as in every run; `created_utc` is that of the first shard.

    Raises:
        RunFileError: A shard is missing, there twice, unfinished, or was made with other settings or versions.
    """
    runs = {folder: read_run(folder) for folder in folders}
    first, *others = runs
    for other in others:
        _require_alike(first, runs[first].info, other, runs[other].info)
    numbers: dict[int, Path] = {}
    for folder, run in runs.items():
        number = int(str(run.info.config[_SHARD]).partition("/")[0])
        if number in numbers:
            raise RunFileError(
                f"{folder}: holds shard {run.info.config[_SHARD]}, as {numbers[number]} does; expected each shard "
                "once. Leave one of them out."
            )
        numbers[number] = folder
    _require_all(numbers, runs)
    for folder, run in runs.items():
        _require_finished(folder, run)
    episodes = sorted((item for run in runs.values() for item in run.episodes), key=_home)
    answers = sorted((item for run in runs.values() for item in run.answers), key=_home)
    if _digest(item.key for item in (*episodes, *answers)) != runs[first].info.config[_OF]:
        raise RunFileError(
            f"{first} and the other shards: hold other episodes than their command chose; expected exactly those. "
            "Make the shards again from untouched folders."
        )
    return Run(info=_whole_info([run.info for run in runs.values()]), episodes=tuple(episodes), answers=tuple(answers))


def _home(item: EpisodeRun | Answer) -> str:
    return item.key.scene


def _require_alike(first: Path, wanted: RunInfo, other: Path, found: RunInfo) -> None:
    """Refuses two shards whose commands, versions or number of shards differ."""
    pairs = {name: (getattr(wanted, name), getattr(found, name)) for name in RunInfo.model_fields}
    pairs |= {f"config.{name}": (wanted.config.get(name), found.config.get(name)) for name in found.config}
    pairs |= {f"config.{name}": (wanted.config[name], found.config.get(name)) for name in wanted.config}
    pairs["number of shards"] = (_num_shards(wanted), _num_shards(found))
    for name in ("run_id", "created_utc", "config", *(f"config.{own}" for own in _OWN)):
        pairs.pop(name)
    for name, (was, now) in pairs.items():
        if was != now:
            what = "chosen episodes differ" if name == f"config.{_OF}" else f"{name} is {now!r}, in {first} {was!r}"
            raise RunFileError(
                f"{other}: {what}; expected shards of one command, one version and one number of shards. Make one of "
                "the shards again with the other's options."
            )


def _num_shards(info: RunInfo) -> int:
    return int(str(info.config[_SHARD]).partition("/")[2])


def _require_all(numbers: Mapping[int, Path], runs: Mapping[Path, Run]) -> None:
    of = _num_shards(runs[numbers[min(numbers)]].info)
    missing = [f"{number}/{of}" for number in range(1, of + 1) if number not in numbers]
    if missing:
        raise RunFileError(
            f"{numbers[min(numbers)].parent}: found {len(numbers)} of {of} shards; expected {', '.join(missing)} too. "
            "Run what is missing, or name its folder."
        )


def _require_finished(folder: Path, run: Run) -> None:
    done, due = len(run.episodes) + len(run.answers), run.info.config[_EPISODES]
    if done != due:
        raise RunFileError(
            f"{folder}: holds {done} of {due} episodes of shard {run.info.config[_SHARD]}; expected all. Give its "
            "command again, which continues."
        )


def _whole_info(infos: Sequence[RunInfo]) -> RunInfo:
    first = min(infos, key=lambda info: info.created_utc)
    config = {name: value for name, value in first.config.items() if name not in _OWN | {_OF, _RUN}}
    return first.model_copy(update={"run_id": str(first.config[_RUN]), "config": config})


def _digest(keys: Iterable[EpisodeKey]) -> str:
    """12 characters that stand for these episodes, whatever their order."""
    return hashlib.sha256("\n".join(sorted(map(str, keys))).encode()).hexdigest()[:12]
