"""Verbs `demo` and `study serve|withdraw|check-db`: a study folder, its store, and people's links."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from human_study.design.plan import PLAN_FILE, StudyPlan, StudyScene, load_plan, save_plan
from human_study.design.planning import make_plan
from human_study.design.secrets import StudySecrets, make_secrets
from human_study.design.study import (
    STUDY_FILE,
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyPog,
    StudyPractice,
    load_study,
    save_study,
)
from human_study.store.database import require_free_space
from human_study.store.requests import Withdrawal, change_study
from human_study.store.store import StudyStore, open_store
from human_study.tickets import token_hash
from personal_viz.cli.study.serve import listen, require_many_recordings, serve_study
from personal_viz.study_app.checked_options import check_options, require_no_scan
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.study_files import require_texts
from sim.episodes.dataset import PersonalDataset, sample_keys
from sim.errors import StudyError
from sim.homes.kind import scene_kind
from sim.types import SPLITS, ClutterLevel, EpisodeKey, Split

DEMO_HOME = "DemoHome"


def demo(*, out: Path, seed: int, port: str) -> int:
    """Invents a home with episodes and serves a study on it."""
    from sim.authoring.generation import invent_dataset

    dataset = out / "dataset"
    if not (dataset / "scenes" / f"{DEMO_HOME}.plan.json").is_file():
        require_writable(out)
        print(f"Inventing a home with episodes in {dataset} ...", flush=True)
        invent_dataset(dataset, name=DEMO_HOME, seed=seed)
    options = ServeOptions(port=_port_from(port))
    return serve_scene(dataset=dataset, scene=DEMO_HOME, out=out / "study", seed=seed, options=options)


def serve(
    *,
    dataset: Path,
    study: Path | None,
    scene: str | None,
    scenes_dir: Path | None,
    out: Path | None,
    split: tuple[Split, ...],
    limit: int | None,
    seed: int,
    actions: Literal["paper4", "paper6"],
    clutter: ClutterLevel,
    rerun: str | None,
    with_pixels: bool,
    **how: Any,
) -> int:
    """Serves a planned study, or one home; `how` are the fields of ServeOptions, `host` for its `hosts`."""
    if (study is None) == (scene is None):
        found = "both a study and --scene" if study else "neither a study nor --scene"
        raise StudyError(f"study serve: found {found}; expected one. Give a planned folder, or --scene to try a home.")
    options = ServeOptions(hosts=how.pop("host"), **how)
    if study is not None:
        asked = {"--out": out, "--split": split, "--limit": limit, "--seed": seed, "--clutter": clutter}
        given = [name for name, value in asked.items() if value]
        if given:
            raise StudyError(
                f"{given[0]}: is for --scene; expected it in {STUDY_FILE} of a planned study. Leave it out."
            )
        return serve_planned(
            folder=study, dataset=dataset, scenes_dir=scenes_dir, options=options, rerun=rerun, with_pixels=with_pixels
        )
    return serve_scene(
        dataset=dataset,
        scene=scene or "",
        scenes_dir=scenes_dir,
        out=out,
        split=split,
        limit=limit,
        seed=seed,
        actions=actions,
        options=options,
        clutter=clutter,
        rerun=rerun,
        with_pixels=with_pixels,
    )


def serve_scene(
    *,
    dataset: Path,
    scene: str,
    scenes_dir: Path | None = None,
    out: Path | None = None,
    split: tuple[Split, ...] = (),
    limit: int | None = None,
    seed: int = 0,
    actions: Literal["paper4", "paper6"] = "paper4",
    options: ServeOptions | None = None,
    clutter: ClutterLevel = 0,
    rerun: str | None = None,
    with_pixels: bool = False,
) -> int:
    """Tries the episodes of one home: a POG and a PAN participant, no pages before the trials. Always a pilot.

    Serves until Ctrl-C; a study folder that exists goes on where it was.
    """
    check_options(run_id=None, limit=limit, seed=seed)
    episodes = PersonalDataset(dataset)
    episodes.require_scene(scene)
    folder = out or Path("runs") / f"study-{scene}"
    options = dataclasses.replace(options or ServeOptions(), pilot=True)
    listen(options).close()  # a port that is taken is told before anything is written
    require_writable(folder)
    kind = scene_kind(episodes, scene, scenes_dir)
    require_no_scan(kind, clutter=clutter)
    config = StudyConfig(
        study=f"{scene[:20]}-{seed}"[:32],
        dataset=StudyDataset(
            sha256=episodes.digest(),
            splits=dict.fromkeys(split or SPLITS, "all"),
            scenes=(scene,),
            stratify="none",
            max_per_scene=None,
            seed=seed,
        ),
        task=("pog", "pan"),
        actions=actions,
        design=StudyDesign(kind="crossed", raters_per_episode=1),
        pog=StudyPog(conditions=("map_open",)),
        flow=("instructions",),
        practice=StudyPractice(pan=0, pog=0),
        checks=StudyChecks(every=None),
        breaks=StudyBreaks(every=None, sitting_max=None),
        clutter=clutter,
    )
    keys = [episode.key for episode in episodes.episodes(splits=split or SPLITS, scenes=(scene,))]
    if not keys:
        raise StudyError(f"{dataset}: scene {scene!r} has no episode in {split}; expected one. Leave --split out.")
    home = StudyScene(name=scene, kind=kind, clutter=clutter)
    plan = _kept_plan(folder, config, home, keys, limit=limit, is_asked=bool(split) or limit is not None)
    return _serve(folder, config, plan, dataset, scenes_dir, options, rerun=rerun, with_pixels=with_pixels)


def serve_planned(
    *,
    folder: Path,
    dataset: Path,
    scenes_dir: Path | None,
    options: ServeOptions,
    rerun: str | None = None,
    with_pixels: bool = False,
) -> int:
    """Serves a study that `study plan` has planned, until Ctrl-C; goes on where it was."""
    config = load_study(folder)
    plan = load_plan(folder, config)
    require_texts(folder, config, plan)
    digest = PersonalDataset(dataset).digest()
    if config.dataset.sha256 != digest:
        raise StudyError(
            f"--dataset {dataset}: its digest is {digest[:12]}; expected {config.dataset.sha256[:12]}, the study's. "
            "Give the dataset that the study was planned with."
        )
    require_may_serve(options, config, [scene.kind for scene in plan.scenes])
    return _serve(folder, config, plan, dataset, scenes_dir, options, rerun=rerun, with_pixels=with_pixels)


def check_db(*, study: Path) -> int:
    """Checks the database file, its hash chains and the keys; brings an earlier version's up to date first."""
    from human_study.store.database import bring_up_to_date, close_to_others
    from human_study.store.folder_check import require_keys, require_same_files
    from human_study.store.records import read_study

    for version in bring_up_to_date(study):
        print(f"{study}: brought to schema version {version}; a copy of the earlier file is in backups")
    with read_study(study) as reader:
        num_events = reader.check()
        require_keys(reader)
        require_same_files(reader)
    close_to_others(study)
    print(f"{study}: {num_events} events, database and hash chains are whole, and the keys open them")
    return 0


def withdraw(*, study: Path, participant: str) -> int:
    """Withdraws a participant who asked the researcher to; a process that serves the study does it, if there is one."""
    config = load_study(study)
    change_study(study, [Withdrawal(participant=participant)])
    done = "everything done is deleted" if config.privacy.on_withdraw == "delete" else "what was done is kept"
    print(f"{study}: {participant} has withdrawn; {done}")
    return 0


def _serve(
    folder: Path,
    config: StudyConfig,
    plan: StudyPlan,
    dataset: Path,
    scenes_dir: Path | None,
    options: ServeOptions,
    *,
    rerun: str | None,
    with_pixels: bool,
) -> int:
    require_free_space(folder)
    require_many_recordings(rerun, plan)
    with open_store(folder, config, plan) as store:
        secrets = make_secrets(folder, [person.code for person in plan.participants])
        _register(store, plan, secrets)
        if options.pilot and not plan.is_pilot:
            store.mark_pilot()
        serve_study(
            store,
            folder=folder,
            dataset=dataset,
            scenes_dir=scenes_dir,
            platform_key=secrets.key_bytes,
            links=[(person.task.upper(), person.code, secrets.tokens[person.code]) for person in plan.participants],
            options=options,
            rerun=rerun,
            with_pixels=with_pixels,
        )
    print(f"Stopped. Everything is in {folder}; see it with: personal-viz study export {folder}")
    return 0


def _register(store: StudyStore, plan: StudyPlan, secrets: StudySecrets) -> None:
    """Registers whom the store does not know yet; the tokens are on disk before, so a kill in between loses nothing."""
    for person in plan.participants:
        token = secrets.tokens[person.code]
        if store.code_of_token(token) is None:
            store.add_participant(person, token_hash(token))


def _kept_plan(
    folder: Path,
    config: StudyConfig,
    home: StudyScene,
    keys: Sequence[EpisodeKey],
    *,
    limit: int | None,
    is_asked: bool,
) -> StudyPlan:
    """The folder's plan, made once.

    Raises:
        StudyError: The folder's plan is not the one that is asked for.
    """
    save_study(folder, config)
    drawn = sample_keys(sorted(keys), per_split=limit, seed=config.dataset.seed)
    plan = make_plan(config, [home], drawn, is_pilot=True)
    if not (folder / PLAN_FILE).is_file():
        save_plan(folder, plan)
        return plan
    found = load_plan(folder, config)
    if found != plan and is_asked:
        raise StudyError(
            f"{folder / PLAN_FILE}: was made with another --split or --limit; expected the same. "
            "Leave both out to go on with it, or give another --out."
        )
    return found


def _port_from(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise StudyError(f"PORT is {text!r}; expected a number from 0 to 65535. Start again: make demo PORT=8090")
    return int(text)


def require_writable(folder: Path) -> None:
    """Makes the folder and writes into it.

    Raises:
        StudyError: That is not possible.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise StudyError(
            f"{folder}: cannot be written ({error.strerror}); expected a folder that you can write. "
            "Give another with --out."
        ) from None
