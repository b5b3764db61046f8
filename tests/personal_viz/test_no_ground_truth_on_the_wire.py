"""Everything that a PAN client, a POG client and an agent are sent is searched for the answer and for clues to it.

Anybody who knows the home's name, an instance's number or an episode's id finds the answer in the public dataset files.
So these tests' files have names and numbers that occur nowhere else, and no byte that a browser gets may hold one.
"""

import base64
import dataclasses
import gzip
import json
import re
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from human_study.design.plan import PRACTICE_FOLDER, StudyScene
from human_study.design.study import (
    HomeView,
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyPractice,
    save_study,
)
from human_study.trial.events import Open
from personal_viz.bots import forms
from personal_viz.bots.crowd import run_bots
from personal_viz.bots.page import BotPage, decoded
from personal_viz.bots.server import Server
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.home.frames import RenderThreads
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.page_script import STATIC
from personal_viz.study_app.server import open_home
from personal_viz.study_app.study_files import PRACTICE_HOME, plan_study
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.render.raycast import Raycaster
from sim.tasks.pan import PanEnv
from sim.types import Action

from ..human_study.small_world import study
from .invented import invented_dataset
from .stage import staged
from .wire import WireClient, line_to, numbers_of, texts_of

pytestmark = pytest.mark.slow
CANARY = "canary"
HOME = "Qz7vLxwTn"
FIRST_INSTANCE = 8_700_000
"""Added to the number of every object."""
FLOOR, EPISODE = "flr-Kq", "7340119"
"""Beginnings of the floors' labels and of the episodes' ids."""
_NUMBERED = re.compile(r"(.+_)(\d+)")


def mark(root: Path) -> None:
    """Gives captions, ownership sentences, objects, episodes and floors words and numbers that occur nowhere else."""
    for path in root.glob("*/content/*.json.gz"):
        content = _marked(json.loads(gzip.decompress(path.read_bytes())))
        for number, episode in enumerate(content["episodes"]):
            nested = isinstance(episode["object_id"], list)
            slots = [f"caption {CANARY}", "", ""]
            episode["description"] = [slots for _ in episode["object_id"]] if nested else slots
            episode["extracted_summary"] = [f"{episode['owner']} owns a {CANARY} in the hall"]
            episode["episode_id"] = f"{EPISODE}{number}"
        path.write_bytes(gzip.compress(json.dumps(content).encode()))
    for path in root.glob("scenes/*.plan.json"):
        path.write_text(json.dumps(_marked(json.loads(path.read_text()))))


def _marked(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _marked(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [_marked(item, key) for item in value]
    if key == "floor_id":
        return f"{FLOOR}{value}"
    if key == "object_id" and isinstance(value, int):
        return FIRST_INSTANCE + value
    if key in ("name", "object_id", "object_name") and (found := _NUMBERED.fullmatch(str(value))):
        return f"{found[1]}{FIRST_INSTANCE + int(found[2])}"
    return value


@pytest.fixture(scope="module")
def marked_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An invented home with marked files."""
    root = tmp_path_factory.mktemp("marked")
    invented_dataset(root, name=HOME, seed=3)
    mark(root)
    goals = PersonalDataset(root).goals(HOME)
    assert all(int(name.rpartition("_")[2]) > FIRST_INSTANCE for name in goals)
    return root


@pytest.fixture(scope="module")
def home(marked_dataset: Path) -> Iterator[Home]:
    """The marked home as a worker opens it."""
    scene = StudyScene(name=HOME, kind="invented")
    opened = open_home(study(), scene, PersonalDataset(marked_dataset), None, threads=RenderThreads(1))
    yield opened
    opened.close()


def assert_no_answer(messages: list[dict[str, Any]], buffers: list[bytes], root: Path) -> None:
    """No caption, ownership sentence, home, instance, episode or floor of the files in anything that was received."""
    texts = [text for message in messages for text in texts_of(message)]
    pictures = [base64.b64decode(found) for text in texts for found in re.findall(r"base64,([A-Za-z0-9+/=]+)", text)]
    everything = texts + [data.decode("latin-1") for data in (*buffers, *pictures)]
    assert len(everything) > 20
    banned = (CANARY, HOME, PRACTICE_HOME, FLOOR, EPISODE)
    for word in (
        *banned,
        "success",
        "extracted_summary",
        "view_points",
        "object_id",
        *PersonalDataset(root).goals(HOME),
    ):
        found = [text for text in everything if word.lower() in text.lower()]
        assert not found, (word, found[0][:300])
    instance = re.compile(rf"(?<![\d.]){FIRST_INSTANCE // 1000}\d\d\d(?!\d)")
    assert not [found[0] for text in everything if (found := instance.search(text))]
    numbers = [number for message in messages for number in numbers_of(message)]
    assert not [number for number in numbers if FIRST_INSTANCE <= number < FIRST_INSTANCE + 1000]


def is_background(message: dict[str, Any]) -> bool:
    """Whether a message is a picture behind the scene."""
    return message["type"] == "BackgroundImageMessage" and message["rgb_data"] is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "condition", "leave_look", "view"),
    [
        ("pan", "none", None, "browser"),
        ("pan", "topdown", "Start walking", "browser"),
        ("pan", "glb", "Start walking", "browser"),
        ("pan", "glb", "Start walking", "server"),
        ("pog", "map_first", "Show what to find", "browser"),
        ("pog", "map_first", "Show what to find", "server"),
        ("pog", "map_open", None, "browser"),
        ("pog", "map_open", None, "server"),
        ("pog", "map_2d", None, "browser"),
    ],
)
def test_no_look_map_or_trial_names_home_or_object(
    home: Home, marked_dataset: Path, task: Any, condition: Any, leave_look: str | None, view: HomeView
) -> None:
    home = dataclasses.replace(home, view=view)
    chosen: dict[str, Any] = (
        {"memory": {"arms": [condition]}} if task == "pan" else {"pog": {"conditions": [condition]}}
    )
    with staged(home, task, condition, **chosen) as stage, line_to(stage.url) as line:
        client = WireClient(line)
        client.send(CAMERA)
        shows_home = condition in ("glb", "map_first", "map_open")
        if shows_home and view == "server":  # its first picture is drawn while the screen is already there
            client.receive_until(is_background, timeout=60)
        if leave_look is not None:
            client.press(leave_look)
        client.give_up()
        client.receive_until(lambda message: "The trial is over" in str(message), timeout=60)
    assert_no_answer(client.messages, client.buffers, marked_dataset)
    kinds = {message["type"] for message in client.messages}
    has_geometry = any("Glb" in kind or "Mesh" in kind for kind in kinds)
    assert has_geometry == (shows_home and view == "browser")
    assert any(map(is_background, client.messages)) == (shows_home and view == "server")
    opened = stage.link.events()[0]
    assert isinstance(opened, Open)
    assert opened.home_view == (view if shows_home else None)
    if task == "pan" and condition == "none":
        numbers = {round(number, 4) for message in client.messages for number in numbers_of(message)}
        for goal in PersonalDataset(marked_dataset).goals(HOME).values():
            assert not {round(goal.position[0], 4), round(goal.position[2], 4)} <= numbers


def plan_marked(root: Path, dataset: Path) -> Path:
    """A study of both tasks with every page, practice and short trials."""
    config = StudyConfig(
        study="flow",
        task=("pan", "pog"),
        dataset=StudyDataset(sha256=PersonalDataset(dataset).digest(), splits={"easy": 1}, stratify="none",
                             max_per_scene=None, seed=3),
        design=StudyDesign(kind="crossed", raters_per_episode=1),
        practice=StudyPractice(pan=1, pog=1),
        checks=StudyChecks(every=None),
        breaks=StudyBreaks(every=1),
        steps=8,
        confidence=True,
    )  # fmt: skip
    invented_dataset(root / "study" / PRACTICE_FOLDER, name=PRACTICE_HOME, seed=4)
    mark(root / "study" / PRACTICE_FOLDER)
    save_study(root / "study", config)
    plan_study(root / "study", dataset, None, pilot=True)
    return root / "study"


@pytest.mark.release  # two minutes: every page of both tasks, by people who read
def test_no_page_practice_or_answer_over_http_names_home_or_object(
    marked_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    received: list[bytes] = []
    take = BotPage.apply

    def keep(page: BotPage, data: bytes) -> None:
        received.append(data)
        take(page, data)

    pages: list[str] = []
    ask = forms.ask

    def keep_page(*asked: Any, **options: Any) -> forms.Reply:
        reply = ask(*asked, **options)
        pages.append(reply.text)
        return reply

    monkeypatch.setattr(BotPage, "apply", keep)
    monkeypatch.setattr(forms, "ask", keep_page)
    with Server(plan_marked(tmp_path, marked_dataset), marked_dataset, workers=1) as server:
        site = server.start()
        figures = run_bots(site, participants=2, seconds=40, rate=10, kinds=["shortest"], seed=1, tasks=("pan", "pog"))
        answers = list(over_http(site.everybody[0].link))
    messages = [message for data in received for message in decoded(data)]
    said = "".join([*(text for message in messages for text in texts_of(message)), *pages])
    for page in ("Practice", "Completion code", "How sure", "consent", "Thank you"):
        assert page in said, (page, figures)
    buffers = [data[16 + int.from_bytes(data[8:16], "little") :] for data in received]
    assert_no_answer(messages, [*buffers, *answers, *(page.encode() for page in pages)], marked_dataset)


def over_http(link: str) -> Iterator[bytes]:
    """Heads and bodies of every page and file that a browser loads."""
    address, token = link.split("/#")
    headers = {"Content-Type": "application/json", "Origin": address}
    body = json.dumps({"token": token}).encode()
    with urllib.request.urlopen(urllib.request.Request(f"{address}/enter", body, headers), timeout=30) as reply:
        found = reply.read()
        yield bytes(reply.headers) + found
    paths = [json.loads(found)["view"], "/", "/page-version", *(f"/static/{path.name}" for path in STATIC.iterdir())]
    for path in paths:
        with urllib.request.urlopen(f"{address}{path}", timeout=30) as reply:
            yield bytes(reply.headers) + reply.read()


def test_an_agent_gets_task_and_senses_only(marked_dataset: Path) -> None:
    dataset = PersonalDataset(marked_dataset)
    scene = open_scene(dataset, HOME)
    renderer = Raycaster(scene.mesh)
    for episode in dataset.episodes():
        told = dataclasses.asdict(episode.task("pan"))
        assert set(told) == {"kind", "description", "queries", "max_steps", "actions", "news"}
        assert CANARY not in str(told)
        assert not any(target.object_name in str(told) for target in episode.targets)
    env = PanEnv(episode.start, scene.navigation, renderer=renderer)
    seen = env.step(Action.LEFT)
    fields = {field.name for field in dataclasses.fields(seen)}
    told = {"message", "query"}
    assert fields == {"rgb", "depth_m", "gps", "compass", "T_start_camera", "camera", "collided", "step"} | told
    assert (seen.message, seen.query) == (None, None)  # home sequences only
