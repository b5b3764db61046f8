"""Sorts POG runs into tables and rows: one table per kind of map, one row per method, seeds averaged by episode."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError
from sim.tasks.run_files import Answer, AnswerMeasures, Run, RunInfo
from sim.types import SPLITS, EpisodeKey

from ..encoders.protocol import ORACLE_SUFFIX
from ..evaluation.settings import GroundSettings

RADII = np.round(np.arange(0.0, 10.01, 0.25), 2)
"""(R,) distances of the curves over distance, metres."""
_METHODS = ("random", "center", "qs", "rpg")
"""The paper's methods in its order; others follow, sorted by name."""
_OF_ROW = ("phrases", "layout", "features", "frame", "method")
"""Config keys that say how a method works; the others describe the map."""
_MAP_FOLDER = "maps"
"""Config key of the folder of map files: it tells apart maps that were made elsewhere."""
_TEXT_ENCODERS = {"hashed": "hashed words", "minilm": "MiniLM"}
_DEFAULTS = {field.name: field.default for field in fields(GroundSettings)}
_KIND_NAMES = {
    "oracle-map": "oracle maps (texts of the episode files in the cells; no camera)",
    "schematic": "maps explored in schematic homes (not HM3D)",
    "invented": "maps explored in invented homes (not HM3D)",
    "scan": "maps explored in scans",
}
_PEOPLE_NAMES = {
    "schematic": "schematic homes (not HM3D)",
    "invented": "invented homes (not HM3D)",
    "scan": "scans",
    "oracle-map": "oracle maps",
}

ConfigValue = str | int | float | bool | None


@dataclass(frozen=True, slots=True)
class MapVariant:
    """The kind of map on which answers were given; results on different variants never share a table."""

    scene_kind: str
    dataset_digest: str
    options: tuple[tuple[str, ConfigValue], ...] = ()
    """Values that differ from the default, by name; empty for people, who see the home itself."""

    @property
    def title(self) -> str:
        """The variant's name in headings."""
        if not self.options:
            return f"People in {_PEOPLE_NAMES[self.scene_kind]}"
        known = dict(self.options)
        parts = [_encoder_text(known)]
        parts.append("storey not given" if known.get("all_storeys") else "storey given")
        parts += [
            f"{name.replace('_', ' ')} {value}"
            for name, value in self.options
            if name not in ("map", "encoder", "all_storeys")
        ]
        kind = _KIND_NAMES[self.scene_kind]
        return ", ".join([kind[0].upper() + kind[1:], *parts])

    def without(self, name: str) -> "MapVariant":
        """The same variant without one option."""
        return MapVariant(self.scene_kind, self.dataset_digest, tuple(item for item in self.options if item[0] != name))


@dataclass(frozen=True)
class MethodTrials:
    """One row: a method's answers on one map variant, averaged over its seeds; or people's, averaged over people."""

    name: str
    who: str
    is_human: bool
    variant: MapVariant
    runs: tuple[RunInfo, ...]
    keys: tuple[EpisodeKey, ...]
    """N episodes in order."""
    within: NDArray[np.float64]
    """(N, R) share of the episode's trials whose first point is within each of RADII of the target."""
    top3_within: NDArray[np.float64] | None
    """(N, R) the same for the nearest of three points; None for people, and if a run holds only the first point."""
    success: NDArray[np.float64]
    """(N,) share of the episode's trials that succeed, as stored with the run."""
    top3: NDArray[np.float64] | None
    """(N,) the same for any of three points; None for people, who give one point and no score."""
    num_trials: int
    num_fallbacks: int
    """Number of trials in which the language model gave nothing that can be used (`Answer.fell_back`)."""

    @cached_property
    def homes(self) -> tuple[str, ...]:
        """(N,) home of each episode."""
        return tuple(key.scene for key in self.keys)

    @cached_property
    def splits(self) -> tuple[str, ...]:
        """(N,) split of each episode."""
        return tuple(key.split for key in self.keys)


def variant_of(info: RunInfo) -> MapVariant:
    """The map variant on which a run's answers were given."""
    if info.who_kind == "human":
        return MapVariant(info.scene_kind, info.dataset_digest)
    always = ("map", "encoder", "all_storeys")
    shown = {
        name: value
        for name, value in info.config.items()
        if name not in _OF_ROW and not name.endswith("_code") and (name in always or value != _DEFAULTS.get(name, ""))
        if name != _MAP_FOLDER or info.config.get("map") == "files"
    }
    shown.setdefault("map", info.condition)  # in case another program made the run
    return MapVariant(info.scene_kind, info.dataset_digest, tuple(sorted(shown.items())))


def _encoder_text(options: dict[str, ConfigValue]) -> str:
    """The encoder of the map's vectors; a walk with a pure text encoder used oracle perception."""
    encoder = str(options.get("encoder", "unknown"))
    plain = encoder.removesuffix(ORACLE_SUFFIX)
    text_encoder = _TEXT_ENCODERS.get(plain, plain if plain != encoder else None)
    if options.get("map") in ("explore", "files") and text_encoder is not None:
        return f"oracle perception ({text_encoder})"
    return f"{encoder} encoder"


def row_name(info: RunInfo) -> str:
    """The name of a run's row in a table; runs that differ only in the seed share it."""
    if info.who_kind == "human":
        return info.who if info.condition == "none" else f"{info.who} ({info.condition.replace('_', ' ')})"
    words = [f"{info.config[name]}" for name in ("layout", "features") if _differs(info, name)]
    phrases = info.config.get("phrases", "none")
    words += [] if phrases in ("none", None) else [f"phrases {phrases}"]
    return f"{info.who} ({', '.join(words)})" if words else info.who


def method_trials(runs: Sequence[Run]) -> list[MethodTrials]:
    """One item per row, the paper's methods first, people last.

    Raises:
        RunFileError: A run holds no answer, an answer was never scored, or two runs hold the same trial.
    """
    groups: dict[tuple[MapVariant, str], list[Run]] = defaultdict(list)
    for run in runs:
        if not run.answers:
            raise RunFileError(
                f"{run.info.run_id}: holds no POG answer; expected some. Leave the run out; "
                '"personal-viz metrics" shows walks.'
            )
        groups[variant_of(run.info), row_name(run.info)].append(run)
    rows = [_trials(variant, name, found) for (variant, name), found in groups.items()]
    return sorted(rows, key=_order)


def ordered_splits(splits: Iterable[str]) -> list[str]:
    """The splits that occur, in the paper's order."""
    found = set(splits)
    return [split for split in SPLITS if split in found]


def _differs(info: RunInfo, name: str) -> bool:
    return name in info.config and info.config[name] != _DEFAULTS.get(name)


def _order(row: MethodTrials) -> tuple[bool, int, str]:
    return row.is_human, _METHODS.index(row.who) if row.who in _METHODS else len(_METHODS), row.name


def _scored_answers(runs: Sequence[Run]) -> dict[EpisodeKey, list[tuple[Answer, AnswerMeasures]]]:
    """The answers to each episode with their measures, without those that failed technically."""
    answers: dict[EpisodeKey, list[tuple[Answer, AnswerMeasures]]] = defaultdict(list)
    seen: dict[tuple[EpisodeKey, str | int | None], str] = {}
    for run in runs:
        for answer in run.answers:
            trial = (answer.key, answer.participant or run.info.seed)
            if trial in seen:
                raise RunFileError(
                    f"{run.info.run_id}: found {answer.key} a second time (first in {seen[trial]}); expected each "
                    "trial once. Give each run once; runs of one method need different seeds."
                )
            seen[trial] = run.info.run_id
            if answer.reason == "technical":
                continue
            if answer.measures is None:
                raise RunFileError(
                    f"{run.info.run_id}: holds no measures for {answer.key}; expected a scored answer. Write the run "
                    "again with personal-viz ground or study export."
                )
            answers[answer.key].append((answer, answer.measures))
    if not answers:
        raise RunFileError(f"{runs[0].info.run_id}: all trials failed technically; expected an answer. Leave it out.")
    return answers


def _trials(variant: MapVariant, name: str, runs: Sequence[Run]) -> MethodTrials:
    scored = _scored_answers(runs)
    keys = sorted(scored, key=lambda key: (SPLITS.index(key.split), key.scene, _number(key.episode_id)))
    answers = [answer for key in keys for answer, _ in scored[key]]
    measures = [[item for _, item in scored[key]] for key in keys]
    is_ranked = any(answer.scores for answer in answers)
    has_three = is_ranked and all(item.planar_distances is not None for found in measures for item in found)

    def means(of: Callable[[AnswerMeasures], bool | NDArray[np.bool_]]) -> NDArray[np.float64]:
        """(N, ...) the mean over each episode's trials."""
        return np.array([np.mean(np.array([of(item) for item in found]), axis=0) for found in measures])

    info = runs[0].info
    return MethodTrials(
        name=name,
        who=info.who,
        is_human=info.who_kind == "human",
        variant=variant,
        runs=tuple(run.info for run in sorted(runs, key=lambda run: run.info.run_id)),
        keys=tuple(keys),
        within=means(lambda item: _within((item.planar_distance,))),
        top3_within=means(lambda item: _within(item.planar_distances or ())) if has_three else None,
        success=means(lambda item: item.success),
        top3=means(lambda item: item.top3_success) if is_ranked else None,
        num_trials=len(answers),
        num_fallbacks=sum(answer.fell_back for answer in answers),
    )


def _number(episode_id: str) -> tuple[int, str]:
    return (int(episode_id), "") if episode_id.isdigit() else (-1, episode_id)


def _within(distances: Iterable[float | None]) -> NDArray[np.bool_]:
    """(R,) whether the nearest of the distances is within each of RADII; None = too far."""
    return min((distance for distance in distances if distance is not None), default=np.inf) <= RADII
