"""Serves a planned study: gateway, viser workers, personal links on the terminal, until Ctrl-C or SIGTERM."""

import contextlib
import functools
import signal
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType

import uvicorn

from human_study.design.plan import StudyPlan
from human_study.design.study import StudyConfig
from human_study.store.store import StudyStore
from human_study.texts.participants import told_texts
from personal_viz.study_app.gateway.admission import Admission, PayFile, Tickets
from personal_viz.study_app.gateway.app import Gateway
from personal_viz.study_app.gateway.http import listen, uvicorn_server
from personal_viz.study_app.gateway.lease_keeper import LeaseKeeper
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.gateway.pages import Pages
from personal_viz.study_app.gateway.upkeep import upkeep
from personal_viz.study_app.gateway.workers import WORKERS_SHARE, WorkerPool
from personal_viz.study_app.operator.dashboard import dashboard, serving_of
from personal_viz.study_app.recruit_codes import CODES_FILE, RecruitCodes, end_code, load_recruit_codes
from personal_viz.study_app.worker_door import WorkerTask
from sim.cache import cache_dir
from sim.errors import StudyError
from sim.types import EpisodeKey


def serve_study(
    store: StudyStore,
    *,
    folder: Path,
    dataset: Path,
    evidence: tuple[Path, ...] = (),
    scenes_dir: Path | None,
    sequences: Path | None = None,
    links: Sequence[tuple[str, str, str]],
    platform_key: bytes,
    options: ServeOptions,
    rerun: str | None = None,
    with_pixels: bool = False,
) -> None:
    """Starts the workers, prints the links, serves until Ctrl-C or SIGTERM, ends everything in `options.drain_s`.

    Args:
        store: The open store, with all participants registered.
        folder: The study's folder.
        dataset: The dataset of the counted trials.
        evidence: Folders of the dataset's evidence.
        scenes_dir: The folder of licensed scans.
        sequences: The set of home sequences, in a study of them.
        links: (label such as PAN, participant's code, personal token) of everybody.
        platform_key: The study's own key for the ids of recruiting platforms.
        options: Addresses, names, limits; `require_may_serve` has accepted them.
        rerun: A folder or a viewer's address, to which trials are streamed for the researcher while they happen.
        with_pixels: Whether the stream holds pictures of licensed scans too.

    Raises:
        StudyError: The port is taken, a worker cannot start, or all workers ended.
    """
    require_may_serve(options, store.config, [scene.kind for scene in store.plan.scenes])
    codes, tickets, keeper = _codes(folder, store.config), Tickets(folder), LeaseKeeper(store, tell=_tell)
    tokens = {code: token for _, code, token in links}
    admission = Admission(
        store, store.config, token_of_code=tokens, platform_key=platform_key, pay_file=PayFile(store.folder)
    )
    scans = str(scenes_dir) if scenes_dir else None
    sources, told = tuple(map(str, evidence)), None if sequences is None else str(sequences)
    print(_opening(store.plan, options.num_workers), flush=True)
    with (
        listen(options.bind, options.port) as listening,
        shown_live(rerun, store.plan) as where,
        ended_by_sigterm(),
        _pool(
            store,
            WorkerTask(str(folder), str(dataset), scans, sources, told, where, with_pixels, options.public),
            tickets,
            options,
        ) as pool,
        upkeep(store, keeper, tell=_tell),
        dashboard(folder, options.dashboard_port, serving=functools.partial(serving_of, pool, keeper)) as page,
    ):
        gateway = _gateway(
            store, admission, pool, tickets=tickets, keeper=keeper, codes=codes, key=platform_key, options=options
        )
        address = options.address(listening.getsockname()[1])
        _print_links(links, address, has_open_link=admission.has_open_link, dashboard_link=page, folder=folder)
        _serve_until_told(uvicorn_server(gateway.app(), options), listening, pool)


def _pool(store: StudyStore, task: WorkerTask, tickets: Tickets, options: ServeOptions) -> WorkerPool:
    return WorkerPool(
        store,
        task.command,
        num_workers=options.num_workers,
        tickets=tickets,
        tell=_tell,
        heartbeat=options.heartbeat,
        end_s=WORKERS_SHARE * options.drain_s,
    )


def require_many_recordings(rerun: str | None, plan: StudyPlan) -> None:
    """Refuses a single file for the recordings of a study.

    Raises:
        StudyError: `rerun` names one file, but a study has several trials.
    """
    if rerun is not None and rerun.endswith(".rrd"):
        num_trials = sum(len(participant.trials) for participant in plan.participants)
        raise StudyError(
            f"--rerun {rerun}: this study has {num_trials} trials; expected one for a single file. "
            "Give a folder (one file per trial), rerun+http://HOST:PORT/proxy or spawn."
        )


@contextlib.contextmanager
def shown_live(rerun: str | None, plan: StudyPlan) -> Iterator[str | None]:
    """The folder or viewer's address to which the workers stream trials; None = nobody watches.

    Raises:
        StudyError: `rerun` names one file, but a study has several trials.
        RecordingError: Nobody listens at the address, or no viewer can be started.
    """
    require_many_recordings(rerun, plan)
    if rerun is None:
        yield None
        return
    trials = [trial for participant in plan.participants for trial in participant.trials]
    from recordings.sinks import live_sink  # Rerun takes a second to import

    keys = [EpisodeKey(trial.split, trial.scene, trial.episode_id) for trial in trials]
    with live_sink(rerun, keys) as sink:
        where = str(Path(sink.where).resolve()) if sink.kind == "folder" else sink.where
        print(f"Trials are shown live, for the researcher only: {where}", flush=True)
        yield where


@contextlib.contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """Lets SIGTERM end the block as Ctrl-C does, so that workers are ended and the store is closed."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _opening(plan: StudyPlan, num_workers: int) -> str:
    """The text for the person at the terminal until the links come."""
    names = plan.scenes[0].name if len(plan.scenes) == 1 else f"{len(plan.scenes)} homes"
    line = f"Opening {names} for {num_workers} viser {'worker' if num_workers == 1 else 'workers'} ..."
    if all(scene.kind != "scan" for scene in plan.scenes):
        return line
    return f"{line} A large scan takes a minute or more the first time; what is made of it is kept in {cache_dir()}."


def _gateway(
    store: StudyStore,
    admission: Admission,
    pool: WorkerPool,
    *,
    tickets: Tickets,
    keeper: LeaseKeeper,
    codes: RecruitCodes,
    key: bytes,
    options: ServeOptions,
) -> Gateway:
    """The web server that participants reach: their pages, and the way to the workers."""
    pages = Pages(
        store,
        texts=told_texts(store.folder, store.plan),
        client_profile=tickets.client_profile,
        end_code=functools.partial(end_code, codes, key),
        warm=pool.warm,
    )
    return Gateway(
        admission,
        pool,
        tickets=tickets,
        options=options,
        pages=pages,
        present=keeper.present,
        screen_out_code=codes.prolific and codes.prolific.screen_out,
        tell=_tell,
        note_error=store.note_error,
    )


def _print_links(
    links: Sequence[tuple[str, str, str]], address: str, *, has_open_link: bool, dashboard_link: str, folder: Path
) -> None:
    """Tells the person at the terminal that people can come, and by which links."""
    for label, code, token in links:
        print(f"  {label}  {code}  {address}/#{token}")
    if has_open_link:
        print(f"  Open link for everybody else: {address}/join")
    print(f"  Progress of participants, for you only: {dashboard_link}")
    print(f"Everything is written to {folder}. Ctrl-C ends the study.", flush=True)


def _codes(folder: Path, config: StudyConfig) -> RecruitCodes:
    """The codes for people who come from a platform.

    Raises:
        StudyError: The study needs codes, but the file has none.
    """
    codes = load_recruit_codes(folder)
    if config.recruit.kind == "prolific" and codes.prolific is None:
        raise StudyError(
            f"{folder / CODES_FILE}: holds no [prolific] codes; expected them, because recruit.kind is prolific. "
            'Write [prolific], completion = "...", screen_out = "..." and no_consent = "..." into it.'
        )
    return codes


def _serve_until_told(server: uvicorn.Server, listener: socket.socket, pool: WorkerPool) -> None:
    def stop_when_ended() -> None:
        pool.ended.wait()
        server.should_exit = True

    threading.Thread(target=stop_when_ended, daemon=True, name="pool-ended").start()
    with contextlib.suppress(KeyboardInterrupt):  # uvicorn has closed the connections by then
        server.run(sockets=[listener])
    if pool.ended.is_set():
        raise StudyError(
            "the viser workers ended by themselves; see their messages above. "
            "Start the study again: nothing acknowledged is lost."
        )


def _tell(line: str) -> None:
    print(f"personal-viz: {line}", file=sys.stderr, flush=True)
