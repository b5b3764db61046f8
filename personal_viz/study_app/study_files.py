"""The plan and the texts of a study before anybody takes part."""

import hashlib
import itertools
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from human_study.design.plan import PRACTICE_FOLDER, StudyPlan, StudyScene, save_plan
from human_study.design.planning import Practice, make_plan
from human_study.design.sampling import sample_episodes
from human_study.design.study import (
    STUDY_FILE,
    StudyConfig,
    load_study,
)
from human_study.export.manifest import Manifest
from human_study.private_files import write_private
from human_study.store.records import DATABASE_FILE
from human_study.texts.catalogue import catalogue_of
from human_study.texts.participants import DEBRIEFING_FILE, TEXT_FILES, freeze_texts, has_other_words
from human_study.texts.words import open_places
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Goal
from sim.episodes.sequence_files import SequenceSet
from sim.errors import StudyError, line_from_validation_error
from sim.files import bounded_json
from sim.homes.kind import scene_kind
from sim.homes.plan import HOMES_VERSION, plan_digest
from sim.scans.hm3d import find_semantics
from sim.scans.semantic_txt import read_semantic_txt
from sim.tasks.provenance import program_release
from sim.types import EpisodeKey

from .study_sequences import make_practice, sequences_by_key, study_set

PRACTICE_HOME = "PracticeHome"
PLACES_FILE = "places.json"
_IN_VIEW = 0.004
"""Least share of the first picture that the target of an attention trial fills."""


class StudyPlaces(BaseModel):
    """`places.json`: where the plan's dataset lay, seen from the study's folder; neither hashed nor exported."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    dataset: str
    evidence: tuple[str, ...] = ()
    scenes_dir: str | None = None
    sequences: str | None = None
    """The set of home sequences."""


class FoundPlaces(NamedTuple):
    """The same as absolute paths."""

    dataset: Path
    evidence: tuple[Path, ...]
    scenes_dir: Path | None
    sequences: Path | None


def plan_study(
    folder: Path,
    dataset: Path,
    scenes_dir: Path | None,
    *,
    evidence: tuple[Path, ...] = (),
    sequences: Path | None = None,
    pilot: bool,
) -> StudyPlan:
    """Makes the plan of a study folder, writes it and returns it.

    Raises:
        PersonalVizError: The study file, the dataset or a home cannot be used.
    """
    config, episodes = load_study(folder), PersonalDataset(dataset, evidence=evidence)
    digest = episodes.digest()
    if config.dataset.sha256 != digest:
        raise StudyError(
            f"{folder / STUDY_FILE}: dataset.sha256 is {config.dataset.sha256[:12]}; expected {digest[:12]}, that of "
            f"{dataset}. Give the dataset that the study is about with its evidence, or correct the field."
        )
    told = study_set(folder, config, sequences)
    pool = _pool(episodes, told)
    keys = sample_episodes(config, list(pool))
    scenes = [study_scene(config, episodes, name, scenes_dir) for name in sorted({key.scene for key in keys})]
    _require_objects(folder, config, scenes, scenes_dir, [(key, pool[key]) for key in keys])
    made = make_plan(config, scenes, keys, practice=_practice(folder, config), is_pilot=pilot)
    made = made.model_copy(update={"texts": freeze_texts(folder, config, made)})
    save_plan(folder, made)
    note_places(folder, dataset, evidence, scenes_dir, sequences=sequences)
    return made


def note_places(
    folder: Path,
    dataset: Path,
    evidence: Sequence[Path],
    scenes_dir: Path | None,
    *,
    sequences: Path | None = None,
) -> None:
    """Writes `places.json` of a study folder.

    Raises:
        StudyError: It cannot be written.
    """
    base = folder.resolve()

    def seen(path: Path) -> str:
        return os.path.relpath(path.resolve(), base)

    places = StudyPlaces(
        dataset=seen(dataset),
        evidence=tuple(seen(each) for each in evidence),
        scenes_dir=None if scenes_dir is None else seen(scenes_dir),
        sequences=None if sequences is None else seen(sequences),
    )
    left_out = {"sequences"} if sequences is None else set[str]()
    write_private(folder / PLACES_FILE, places.model_dump_json(indent=1, exclude=left_out) + "\n")


def places_of(folder: Path) -> FoundPlaces:
    """Where the dataset of a study's plan lay.

    Raises:
        StudyError: The study was planned by a version that did not note it, or the file is damaged.
    """
    path = folder / PLACES_FILE
    try:
        places, base = StudyPlaces.model_validate_json(bounded_json(path)), folder.resolve()
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected the place of the study's dataset. Give --dataset."
        ) from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice="Give --dataset.")) from None
    return FoundPlaces(
        (base / places.dataset).resolve(),
        tuple((base / each).resolve() for each in places.evidence),
        None if places.scenes_dir is None else (base / places.scenes_dir).resolve(),
        None if places.sequences is None else (base / places.sequences).resolve(),
    )


def study_scene(config: StudyConfig, dataset: PersonalDataset, name: str, scenes_dir: Path | None) -> StudyScene:
    """A home of the study as it is now, with the digest of its plan if it is made from one.

    Raises:
        PersonalVizError: The home's plan is damaged or cannot be recovered.
    """
    from sim.homes.open_home import home_plan  # loads numba

    kind = scene_kind(dataset, name, scenes_dir)
    clutter = 0 if kind == "scan" else config.clutter
    digest = plan_digest(home_plan(dataset, name, clutter=clutter)) if scenes_dir is None else ""
    return StudyScene(name=name, kind=kind, clutter=clutter, labels=config.labels, plan_digest=digest)


def require_same_homes(
    planned: StudyPlan | Manifest, scenes: Iterable[StudyScene], dataset: PersonalDataset, scenes_dir: Path | None
) -> None:
    """Refuses homes that differ from those on which a study was planned.

    A home in a file of `scenes_dir` does not depend on the program; trials tell other files by their scene digest.

    Args:
        planned: The study's plan, or an export of it.
        scenes: Homes of the plan that are to be opened.
        dataset: The dataset of these homes.
        scenes_dir: The folder of scans.

    Raises:
        StudyError: A home is of another kind, of another version, or made from another plan.
    """
    from sim.homes.open_home import home_plan

    for scene in scenes:
        kind = scene_kind(dataset, scene.name, scenes_dir)
        if kind != scene.kind:
            advice = "Give --scenes-dir" if scene.kind == "scan" else "Give the study's --dataset, without --scenes-dir"
            raise StudyError(
                f"{dataset.root}: home {scene.name} opens as {kind!r} here; expected {scene.kind!r}, as the study was "
                f"planned. {advice}."
            )
        if scenes_dir is not None:
            continue
        if planned.homes_version != HOMES_VERSION:
            raise StudyError(
                f"home {scene.name}: the study was planned on homes of version {planned.homes_version}, this program "
                f"({program_release()}) makes version {HOMES_VERSION}; expected the same, because people walk in one "
                f"home. Serve and verify it with {planned.made_by}, or plan it again while nobody has taken part; "
                "export and report work with any."
            )
        if (
            scene.plan_digest
            and plan_digest(home_plan(dataset, scene.name, clutter=scene.clutter)) != scene.plan_digest
        ):
            raise StudyError(
                f"{dataset.root}: the plan of home {scene.name} differs from the one on which the study was "
                f"planned ({scene.plan_digest[:12]}); expected the same. Restore scenes/{scene.name}.plan.json, or the "
                f"dataset and the packages of that time ({planned.made_by})."
            )


def require_texts(folder: Path, config: StudyConfig, made: StudyPlan) -> None:
    """Refuses texts that were changed after the plan, and texts with places to fill in that an earlier version allowed.

    A study that has begun keeps its texts. Where the program's own texts are others now, a line says so.

    Raises:
        StudyError: A text was changed or is not filled in; the message names the file.
    """
    if made.texts and DEBRIEFING_FILE not in made.texts and (folder / DEBRIEFING_FILE).exists():
        raise StudyError(
            f"{folder / DEBRIEFING_FILE}: was written after the plan; expected the texts that were planned. Move it "
            "away, or make the plan again before anybody takes part."
        )
    if has_other_words(config, made):
        print(
            f"The program's own texts for participants ({config.language}) differ from those of {made.made_by}, with "
            "which the study was planned: people read the new ones. Serve it with that version to keep the old ones.",
            file=sys.stderr,
        )
    for name in sorted(made.texts.keys() - {catalogue_of(config.language).name}):
        expected = made.texts[name]
        path = folder / name
        found = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "nothing"
        if found != expected:
            raise StudyError(
                f"{path}: sha256 is {found[:12]}; expected {expected[:12]}, the text that was planned. Restore it, or "
                "make the plan again before anybody takes part."
            )
        left = open_places(path.read_text(encoding="utf-8"))
        if left and path.stem in config.flow and name in TEXT_FILES and not (folder / DATABASE_FILE).exists():
            raise StudyError(
                f"{path}: {', '.join(left)} to be filled in; expected a text that people can read. Fill in study.yaml "
                "and make the plan again."
            )


def _pool(episodes: PersonalDataset, told: SequenceSet | None) -> dict[EpisodeKey, tuple[Goal, ...]]:
    """The targets of each episode, or of each home sequence."""
    if told is None:
        return {episode.key: episode.targets for episode in episodes.episodes()}
    found = sequences_by_key(told)
    return {key: tuple(itertools.chain(*sequence.targets)) for key, sequence in found.items()}


def _require_objects(
    folder: Path,
    config: StudyConfig,
    scenes: Sequence[StudyScene],
    scenes_dir: Path | None,
    trials: Sequence[tuple[EpisodeKey, tuple[Goal, ...]]],
) -> None:
    """Refuses homes without what `pog` of the study file promises; homes made from a plan have it all.

    Raises:
        StudyError: Objects are to be marked or named and the files of a scan tell of none, or not of a target of these
            episodes; or rooms of a scan are to be named.
    """
    from sim.homes.open_home import find_scan

    pog = config.pog
    if "pog" not in config.task or scenes_dir is None:
        return
    for scene in scenes:
        if pog.room_names != "off" and scene.kind == "scan":
            raise StudyError(
                f"{folder / STUDY_FILE}: pog.room_names is {pog.room_names!r}, but {scene.name} is a scan, which does "
                "not name its rooms; expected off. Take pog.room_names: off."
            )
        named = {"pog.pointing": pog.pointing == "snap", "pog.object_names": pog.object_names in ("on", "demand")}
        field = next((field for field, is_asked in named.items() if is_asked), None)
        scan = find_scan(scene.name, scenes_dir)
        semantics = find_semantics(scan, scene.name) if field is not None else None
        if field is not None and semantics is None:
            value, other = (pog.pointing, "free") if field == "pog.pointing" else (pog.object_names, "off")
            raise StudyError(
                f"{folder / STUDY_FILE}: {field} is {value!r}, but no file tells of the objects of {scan}; expected "
                f"{scene.name}.semantic.glb and .semantic.txt beside it. Take {field}: {other}, or scans with "
                "semantics."
            )
        if field == "pog.pointing" and semantics is not None:
            _require_targets(folder, semantics[1], [each for each in trials if each[0].scene == scene.name])


def _require_targets(folder: Path, semantic_txt: Path, trials: Sequence[tuple[EpisodeKey, tuple[Goal, ...]]]) -> None:
    """Refuses episodes with a target that the scan does not list: a mark could not go to it.

    Raises:
        PersonalVizError: There is one, or the text is damaged.
    """
    names = {label.name for label in read_semantic_txt(semantic_txt)}
    for key, targets in trials:
        missing = next((goal.object_name for goal in targets if goal.object_name not in names), None)
        if missing is not None:
            raise StudyError(
                f"{folder / STUDY_FILE}: pog.pointing is 'snap', but {semantic_txt} does not list {missing!r}, a "
                f"target of {key}; expected every target. Take pog.pointing: free, or the semantics of the "
                "release that the episodes are made on."
            )


def _practice(folder: Path, config: StudyConfig) -> Practice | None:
    """Practice and attention trials in an invented home outside the study's pool, made from the study's seed."""
    wanted = sum(config.practice.pan if task == "pan" else config.practice.pog for task in config.task)
    if not wanted and config.checks.every is None:
        return None
    from sim.authoring.generation import invent_dataset

    root = folder / PRACTICE_FOLDER
    if not (root / "scenes" / f"{PRACTICE_HOME}.plan.json").is_file():
        invent_dataset(root, name=PRACTICE_HOME, seed=config.dataset.seed + 1)
    in_view = _by_view(PersonalDataset(root), config)
    plain = tuple(key for key, share in in_view if share >= _IN_VIEW)
    if config.checks.every is not None and not plain:
        raise StudyError(
            f"study {config.study}: no episode of the practice home begins with its target in plain view; expected one "
            "for attention trials. Change dataset.seed, or set checks.every to null."
        )
    practice = config.model_copy(update={"clutter": 0})
    scene = study_scene(practice, PersonalDataset(root), PRACTICE_HOME, None)
    if config.sequences is not None:
        shown = [PersonalDataset(root).episode(key) for key in plain]
        return Practice((scene,), *make_practice(folder, PRACTICE_HOME, seed=config.dataset.seed + 1, in_view=shown))
    return Practice((scene,), tuple(key for key, _ in in_view), plain)


def _by_view(dataset: PersonalDataset, config: StudyConfig) -> list[tuple[EpisodeKey, float]]:
    """Episodes of the practice home with the share of the first picture that their target fills, largest first."""
    from sim.frames import T_world_camera
    from sim.homes.open_home import open_scene
    from sim.homes.renderers import renderer_of

    scene = open_scene(dataset, PRACTICE_HOME)
    renderer = renderer_of(scene)
    ids = {item.name: item.instance_id for item in scene.objects}
    shares = []
    for episode in dataset.episodes(scenes=(PRACTICE_HOME,)):
        camera = config.robot_camera
        seen = renderer.render(T_world_camera(episode.start, camera), camera).instance_ids
        targets = [ids[goal.object_name] for goal in episode.targets if goal.object_name in ids]
        shares.append((episode.key, float(np.isin(seen, targets).mean())))
    return sorted(shares, key=lambda item: (-item[1], item[0]))
