"""The viser worker: a child process of the gateway that serves a few participants on loopback.

It owns homes, simulator and viser; the store stays with the gateway, at the other end of a local socket.
"""

import asyncio
import contextlib
import socket
import sys
import time
import warnings
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import msgspec
import viser

from human_study.design.plan import PRACTICE_FOLDER, StudyScene, load_plan
from human_study.design.study import StudyConfig, load_study
from human_study.texts.catalogue import catalogue_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.errors import PersonalVizError, StudyError
from sim.homes.open_home import home_plan, open_scene
from sim.homes.renderers import renderer_of
from sim.homes.storey_names import storey_labels
from sim.render.raycast import Raycaster
from sim.tasks.pog import PogScene
from sim.tasks.rules import scene_storeys

from .home.frames import Frames, RenderThreads
from .home.homes import Home, HomeLibrary, pan_env
from .home.names import names_of_rooms
from .home.surfaces import StoreyCopies
from .screens.camera import storey_names
from .screens.seat import Seat, Study
from .store_link import StoreLink
from .study_sequences import PRACTICE_SET, sequences_by_key
from .watch import Watches
from .worker_door import WorkerDoor, WorkerTask, make_updates_safe, open_door


def main() -> None:
    """Serves until the gateway closes the socket; `WorkerTask.command` is the command line."""
    fd, task = sys.argv[1:]
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")  # people leave in mid-trial
    link = StoreLink(socket.socket(fileno=int(fd)))
    try:
        study = open_study(msgspec.json.decode(task, type=WorkerTask))
        with study.homes.use(study.plan.scenes[0].name) as home:
            home.try_out(study.config)  # fails, if at all, before anybody comes
            server, door = serve(study, link)
    except PersonalVizError as error:
        with contextlib.suppress(StudyError):  # the gateway may close before it answers
            link.tell_failed(str(error))
        sys.exit(1)
    link.on_warm = study.homes.warm
    link.tell_ready(door)
    link.is_closed.wait()
    server.stop()
    study.homes.close()


def open_study(task: WorkerTask) -> Study:
    """A study with a library of its homes, of which none is open yet.

    Raises:
        PersonalVizError: Study, plan or datasets cannot be read.
    """
    folder, scenes_dir = Path(task.study), Path(task.scenes_dir) if task.scenes_dir else None
    config = load_study(folder)
    plan = load_plan(folder, config)
    counted = PersonalDataset(task.dataset, evidence=task.evidence)
    practice = PersonalDataset(folder / PRACTICE_FOLDER) if plan.practice_scenes else None
    told = None if task.sequences is None else SequenceSet(task.sequences)
    practised = SequenceSet(folder / PRACTICE_SET) if practice is not None and told is not None else None
    shared = {"threads": RenderThreads(), "public": task.public}

    def open_one(name: str) -> Home:
        scene = plan.scene(name)
        if practice is not None and scene in plan.practice_scenes:
            return open_home(config, scene, practice, None, sequences=practised, **shared)
        watched = {"rerun": task.rerun, "with_pixels": task.with_pixels, "is_pilot": plan.is_pilot}
        return open_home(config, scene, counted, scenes_dir, sequences=told, **shared, **watched)

    return Study(config, plan, HomeLibrary(open_one), time.monotonic())


def open_home(
    config: StudyConfig,
    study_scene: StudyScene,
    dataset: PersonalDataset,
    scenes_dir: Path | None,
    *,
    threads: RenderThreads,
    sequences: SequenceSet | None = None,
    public: bool = False,
    rerun: str | None = None,
    with_pixels: bool = False,
    is_pilot: bool = False,
) -> Home:
    """One of the study's homes with everything that its participants and a watching researcher need.

    Raises:
        PersonalVizError: Scene or episodes cannot be read, or a system library is missing.
    """
    name = study_scene.name
    scene = open_scene(dataset, name, scenes_dir=scenes_dir, clutter=study_scene.clutter, labels=study_scene.labels)
    renderer = Frames(renderer_of(scene, threads=1), threads, keep_depth=rerun is not None)
    observers = None
    if rerun is not None:
        from .watch_rerun import RerunObservers  # Rerun takes a second to import

        observers = RerunObservers(scene, config, rerun, with_pixels=with_pixels, is_pilot=is_pilot)
    has_rooms = config.pog.room_names != "off" and scene.kind != "scan"
    plan = home_plan(dataset, name, clutter=study_scene.clutter) if has_rooms else None
    labels = storey_labels(scene.navigation.storey_heights, dataset.goals(name).values())
    names = storey_names(catalogue_of(config.language), config.storey_names, labels)
    copies, view = StoreyCopies(scene, names), config.view_of(scene.kind, public=public)
    if view == "browser":
        _ = copies.glbs  # before anybody waits for them
    return Home(
        scene=scene,
        renderer=renderer,
        pog_scene=PogScene(scene, make_renderer=Raycaster),
        copies=copies,
        episodes={episode.key: episode for episode in dataset.episodes(scenes=(name,))},
        sequences={} if sequences is None else sequences_by_key(sequences, name),
        storeys=scene_storeys(dataset.goals(name).values()),
        storey_labels=labels,
        watches=Watches(observers, make_env=lambda episode: pan_env(episode, scene, renderer, config)),
        threads=threads,
        view=view,
        rooms=() if plan is None else names_of_rooms(plan, scene.navigation.storey_heights),
    )


def serve(study: Study, link: StoreLink) -> tuple[viser.ViserServer, WorkerDoor]:
    """A viser server behind a door that gives every admitted connection a seat."""
    server, door = open_door()
    server.scene.set_up_direction("+y")  # before any camera is placed, because the browser turns cameras with the scene
    seats: dict[int, Seat] = {}

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        ticket, connection = address_of(server, client.client_id)
        code = await asyncio.get_running_loop().run_in_executor(None, link.code_of_ticket, ticket)
        if code is None or client.client_id not in server.get_clients():
            return  # unknown, or gone while we asked
        make_updates_safe(client)
        others = [seat for seat in seats.values() if seat.code == code]
        older = [seat for seat in others if seat.connection <= connection]
        mine = Seat(client, code, link, study, connection=connection, took_over=bool(older))
        for seat in older if len(older) == len(others) else (*older, mine):  # the ticket of a newer one was found first
            seat.supersede()
        seats[client.client_id] = mine

    @server.on_client_disconnect
    async def _(client: viser.ClientHandle) -> None:
        seat = seats.pop(client.client_id, None)
        if seat is not None:
            seat.leave()

    return server, door


def address_of(server: viser.ViserServer, client_id: int) -> tuple[str, int]:
    """Ticket and number in a connection's URL, or `("", 0)` (private API of the pinned viser; a test watches it)."""
    connection = server._websock_server._live_connections.get(client_id)
    request = connection.request if connection is not None else None
    asked = parse_qs(urlsplit(request.path).query) if request is not None else {}
    number = asked.get("connection", ["0"])[0]
    return asked.get("ticket", [""])[0], int(number) if number.isdecimal() else 0


if __name__ == "__main__":
    main()
