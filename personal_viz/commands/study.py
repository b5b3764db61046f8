"""Verbs `demo` and `study serve|export|check-db`: the gateway process, its store and its viser worker."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from pathlib import Path
from typing import Literal

import uvicorn

from human_study.plan import PLAN_FILE, StudyPlan, load_plan, make_plan, save_plan
from human_study.store import StudyStore, open_store
from human_study.study import StudyConfig, StudyScene, save_study
from human_study.tickets import new_token, token_hash
from personal_viz.commands.options import check_options, require_no_scan
from personal_viz.gateway import Gateway, Tickets
from personal_viz.store_link import StoreService
from sim.cache import cache_dir
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.scenes.kind import scene_kind
from sim.types import SPLITS, ClutterLevel, EpisodeKey, Split

SECRETS_FILE = "secrets.json"
"""Personal tokens in clear, readable by the owner only; never exported."""
DEMO_HOME = "DemoHome"
WORKER_START_S = 600.0
"""A worker that ends is noticed at once; this is for one that hangs. A scan of a million triangles takes half a minute
the first time (two cores that do nothing else), then four seconds."""
HOSTS = frozenset({"127.0.0.1", "localhost"})


def demo(*, out: Path, seed: int, port: str) -> int:
    """Invents a home with episodes and serves a study on it."""
    from sim.episodes.generation import invent_dataset

    dataset = out / "dataset"
    if not (dataset / "scenes" / f"{DEMO_HOME}.plan.json").is_file():
        _require_writable(out)
        print(f"Inventing a home with episodes in {dataset} ...", flush=True)
        invent_dataset(dataset, name=DEMO_HOME, seed=seed)
    return serve(
        dataset=dataset,
        scene=DEMO_HOME,
        scenes_dir=None,
        out=out / "study",
        split=(),
        limit=None,
        seed=seed,
        actions="paper4",
        port=_port_from(port),
    )


def serve(
    *,
    dataset: Path,
    scene: str,
    scenes_dir: Path | None,
    out: Path | None,
    split: tuple[Split, ...],
    limit: int | None,
    seed: int,
    actions: Literal["paper4", "paper6"],
    port: int,
    clutter: ClutterLevel = 0,
    rerun: str | None = None,
    with_pixels: bool = False,
) -> int:
    """Serves the study until Ctrl-C; a study folder that exists goes on where it was.

    `rerun` shows each trial while it happens to the researcher, with pictures of scans only `with_pixels`.
    """
    check_options(run_id=None, limit=limit, seed=seed)
    episodes = PersonalDataset(dataset)
    episodes.require_scene(scene)
    folder = out or Path("runs") / f"study-{scene}"
    listener = _listen(port)
    with contextlib.closing(listener):
        _require_writable(folder)
        kind = scene_kind(episodes, scene, scenes_dir)
        require_no_scan(kind, clutter=clutter)
        config = StudyConfig(
            study=f"{scene[:20]}-{seed}"[:32],
            dataset_digest=episodes.digest(),
            scenes=(StudyScene(name=scene, kind=kind, clutter=clutter),),
            actions=actions,
            seed=seed,
        )
        save_study(folder, config)
        plan = _plan(folder, config, episodes, scene=scene, split=split, limit=limit)
        with _shown_live(rerun, plan) as where, open_store(folder, config) as store:
            tokens = _tokens(folder, store, plan)
            print(_opening(config.scenes[0]), flush=True)
            more = [*(["--rerun", where] if where else []), *(["--with-pixels"] if with_pixels else [])]
            _run(store, dataset, scenes_dir, listener, plan, tokens, more)
    print(f"Stopped. Everything is in {folder}; see it with: personal-viz study export {folder}")
    return 0


def export(*, study: Path, out: Path) -> int:
    """Writes finished trials as run folders."""
    from human_study.export import export_study

    for folder in export_study(study, out):
        print(f"Written to {folder}")
    return 0


def verify(*, study: Path, dataset: Path, scenes_dir: Path | None) -> int:
    """Re-simulates every finished trial; exit code 1 when one differs from its record."""
    from human_study.records import read_study
    from human_study.verify import verify_trial
    from sim.scenes.sources import open_scene
    from sim.tasks.rules import scene_storeys

    episodes = PersonalDataset(dataset)
    found: dict[str, int] = {}
    with read_study(study) as reader:
        home = reader.config.scenes[0]
        scene = open_scene(episodes, home.name, scenes_dir=scenes_dir, clutter=home.clutter)
        storeys = scene_storeys(episodes.goals(scene.name).values())
        for status in (status for code in reader.codes() for status in reader.trials(code)):
            if status.outcome is None or status.trial_id is None:
                continue
            done = verify_trial(
                [stored.event for stored in reader.events(status.trial_id)],
                status.outcome,
                episodes.episode(status.key),
                navigation=scene.navigation,
                scene_digest=scene.digest,
                storeys=storeys,
                participant=status.code,
            )
            found[done.status] = found.get(done.status, 0) + 1
            if done.status != "verified":
                print(
                    f"{status.code}, trial {status.order_no} ({status.task} {status.key}): {done.status}: {done.detail}"
                )
    print(f"{study}: " + (", ".join(f"{count} {name}" for name, count in sorted(found.items())) or "no finished trial"))
    return 0 if set(found) <= {"verified"} else 1


def check_db(*, study: Path) -> int:
    """Checks the database file and its hash chains."""
    from human_study.records import read_study

    with read_study(study) as reader:
        num_events = reader.check()
    print(f"{study}: {num_events} events, database and hash chains are whole")
    return 0


def _opening(scene: StudyScene) -> str:
    """What a person at the terminal reads until the links come."""
    if scene.kind != "scan":
        return f"Opening {scene.name} ..."
    return (
        f"Opening {scene.name} ... A large scan takes a minute or more the first time; what is made of it for "
        f"browsers is kept in {cache_dir()}."
    )


def _plan(
    folder: Path,
    config: StudyConfig,
    dataset: PersonalDataset,
    *,
    scene: str,
    split: tuple[Split, ...],
    limit: int | None,
) -> StudyPlan:
    """The folder's plan, made once: one POG and one PAN participant over the scene's episodes.

    Raises:
        StudyError: The folder's plan is not the one that `split` and `limit` ask for.
    """
    keys = [episode.key for episode in dataset.episodes(splits=split or SPLITS, scenes=(scene,))]
    if not keys:
        raise StudyError(f"{dataset.root}: scene {scene!r} has no episode in {split}; expected one. Leave --split out.")
    plan = make_plan(config, keys, ("pog", "pan"), limit=min(limit, len(keys)) if limit is not None else None)
    if not (folder / PLAN_FILE).is_file():
        save_plan(folder, plan)
        return plan
    found = load_plan(folder, config)
    if found != plan and (split or limit is not None):
        raise StudyError(
            f"{folder / PLAN_FILE}: was made with another --split or --limit; expected the same. "
            "Leave both out to go on with it, or give another --out."
        )
    return found


def _tokens(folder: Path, store: StudyStore, plan: StudyPlan) -> dict[str, str]:
    """Personal token of each participant: written first, then registered, so that a kill in between loses nothing."""
    path = folder / SECRETS_FILE
    tokens: dict[str, str] = json.loads(path.read_text()) if path.is_file() else {}
    missing = {person.code: new_token() for person in plan.participants if person.code not in tokens}
    if missing:
        tokens |= missing
        beside = path.with_name(path.name + ".part")
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
            json.dump(tokens, file, indent=2)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    for person in plan.participants:
        if store.code_of_token(tokens[person.code]) is None:
            store.add_participant(person.code, token_hash(tokens[person.code]), person.trials)
    return tokens


def _run(
    store: StudyStore,
    dataset: Path,
    scenes_dir: Path | None,
    listener: socket.socket,
    plan: StudyPlan,
    tokens: dict[str, str],
    more: Sequence[str],
) -> None:
    """Starts the worker (with `more` arguments), prints the links, serves until Ctrl-C, ends the worker.

    Raises:
        StudyError: The worker cannot start, or ended while it was needed.
    """
    tickets = Tickets()

    def code_of_ticket(ticket_id: str) -> str | None:
        ticket = tickets.find(ticket_id)
        return ticket.code if ticket else None

    worker_ended = threading.Event()
    with _worker(store, dataset, scenes_dir, code_of_ticket, worker_ended, more) as worker_port:
        app = Gateway(store.code_of_token, worker_port, tickets=tickets, hosts=HOSTS).app()
        server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_level="warning",
                access_log=False,
                ws_max_size=64 * 1024,
                server_header=False,
                timeout_graceful_shutdown=3,
            )
        )
        address = f"http://127.0.0.1:{listener.getsockname()[1]}"
        for participant in plan.participants:
            task = participant.trials[0].task
            print(f"  {task.upper()}  {participant.code}  {address}/#{tokens[participant.code]}")
        print(f"Everything is written to {store.folder}. Ctrl-C ends the study.", flush=True)
        threading.Thread(target=_stop_when, args=(worker_ended, server), daemon=True).start()
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[listener])
        if worker_ended.is_set():
            raise StudyError(
                "the viser worker ended by itself; see its message above. "
                "Start the study again: nothing acknowledged is lost."
            )


@contextlib.contextmanager
def _shown_live(rerun: str | None, plan: StudyPlan) -> Iterator[str | None]:
    """Where the worker streams trials to, a folder or a viewer's address; None = nobody watches.

    Raises:
        StudyError: `rerun` names one file: a study has several trials.
        RecordingError: Nobody listens at the address, or no viewer can be started.
    """
    if rerun is None:
        yield None
        return
    num_trials = sum(len(participant.trials) for participant in plan.participants)
    if rerun.endswith(".rrd"):
        raise StudyError(
            f"--rerun {rerun}: this study has {num_trials} trials; expected one for a single file. "
            "Give a folder (one file per trial), rerun+http://HOST:PORT/proxy or spawn."
        )
    from recordings.live import live_sink  # Rerun takes a second to import

    keys = [
        EpisodeKey(trial.split, trial.scene, trial.episode_id)
        for person in plan.participants
        for trial in person.trials
    ]
    with live_sink(rerun, keys) as sink:
        where = str(Path(sink.where).resolve()) if sink.kind == "folder" else sink.where
        print(f"Trials are shown live, for the researcher only: {where}", flush=True)
        yield where


def _stop_when(worker_ended: threading.Event, server: uvicorn.Server) -> None:
    worker_ended.wait()
    server.should_exit = True


@contextlib.contextmanager
def _worker(
    store: StudyStore,
    dataset: Path,
    scenes_dir: Path | None,
    code_of_ticket: Callable[[str], str | None],
    ended: threading.Event,
    more: Sequence[str],
) -> Iterator[int]:
    """The viser worker's port; the worker ends with the block. `ended` is set when it is gone."""
    ours, theirs = socket.socketpair()
    command = [sys.executable, "-m", "personal_viz.server", "--fd", str(theirs.fileno())]
    command += ["--study", str(store.folder), "--dataset", str(dataset)]
    command += ["--scenes-dir", str(scenes_dir)] if scenes_dir else []
    command += more
    # a session of its own: Ctrl-C reaches the gateway alone, which then closes the socket
    # and no standard output: viser prints its own address there, which participants must not use
    process = subprocess.Popen(command, pass_fds=[theirs.fileno()], start_new_session=True, stdout=subprocess.DEVNULL)
    theirs.close()
    service = StoreService(ours, store, code_of_ticket=code_of_ticket, on_end=ended.set)
    try:
        yield service.started.result(timeout=WORKER_START_S)
    except FutureTimeoutError:
        raise StudyError(
            f"the viser worker was not ready within {WORKER_START_S:.0f} s; expected a scene that loads faster. "
            "Start again when the machine is less busy, or use a smaller scene."
        ) from None
    finally:
        service.close()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _listen(port: int) -> socket.socket:
    """A listening socket on loopback; raises StudyError when the port is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
        listener.listen(128)  # browsers that come before the server runs wait instead of failing
    except OSError as error:
        listener.close()
        raise StudyError(
            f"port {port}: cannot be used ({error.strerror}); expected a free one. Take another: make demo PORT=8090, "
            "or --port 8090."
        ) from None
    return listener


def _require_writable(folder: Path) -> None:
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


def _port_from(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise StudyError(f"PORT is {text!r}; expected a number from 0 to 65535. Start again: make demo PORT=8090")
    return int(text)
