"""Everything that a PAN client, a POG client and an agent are sent is walked for the answer."""

import dataclasses
import gzip
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from personal_viz.served import start_study
from sim.episodes.dataset import PersonalDataset
from sim.episodes.generation import invent_dataset
from sim.scenes.sources import open_scene
from sim.tasks.pan import PanEnv
from sim.types import Action
from sim.world.raycast import Raycaster

from .wire import WireClient, enter, numbers_of, texts_of

CANARY = "canary"


@pytest.fixture(scope="module")
def marked_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An invented home whose captions and ownership sentences are words that stand nowhere else."""
    root = tmp_path_factory.mktemp("marked")
    invent_dataset(root, name="Marked", seed=3)
    for path in root.glob("*/content/*.json.gz"):
        content = json.loads(gzip.decompress(path.read_bytes()))
        for episode in content["episodes"]:
            nested = isinstance(episode["object_id"], list)
            slots = [f"caption {CANARY}", "", ""]
            episode["description"] = [slots for _ in episode["object_id"]] if nested else slots
            episode["extracted_summary"] = [f"{episode['owner']} owns a {CANARY} in the hall"]
        path.write_bytes(gzip.compress(json.dumps(content).encode()))
    return root


@pytest.fixture
def links(marked_dataset: Path, tmp_path: Path) -> Iterator[dict[str, str]]:
    """Personal links of a study on that home."""
    study = start_study(tmp_path / "study", "study", "serve", "--dataset", str(marked_dataset), "--scene", "Marked")
    try:
        yield study.links
    finally:
        assert study.end() == 0


def assert_no_answer(client: WireClient, dataset: PersonalDataset) -> None:
    """No caption, no ownership sentence, no object name, no word on success in anything received."""
    names = list(dataset.goals("Marked"))
    assert names
    everything = [text for message in client.messages for text in texts_of(message)]
    everything += [data.decode("latin-1") for data in client.buffers]
    for word in (CANARY, "success", "extracted_summary", "view_points", "object_id", *names):
        assert not any(word in text for text in everything), word


def test_a_pan_client_gets_pictures_and_texts_only(links: dict[str, str], marked_dataset: Path) -> None:
    dataset = PersonalDataset(marked_dataset)
    with enter(links["pan"]) as client:
        client.press("Start")
        client.see_step(0)
        client.press("Turn left (A or Left)")
        client.see_step(1)
        client.give_up()
        client.receive_until(lambda message: "is stored" in str(message))
    assert_no_answer(client, dataset)
    assert not [message for message in client.messages if "Glb" in message["type"] or "Mesh" in message["type"]]
    numbers = {round(number, 4) for message in client.messages for number in numbers_of(message)}
    for goal in dataset.goals("Marked").values():
        assert not {round(goal.position[0], 4), round(goal.position[2], 4)} <= numbers


def test_a_pog_client_gets_the_home_but_not_which_object(links: dict[str, str], marked_dataset: Path) -> None:
    dataset = PersonalDataset(marked_dataset)
    with enter(links["pog"]) as client:
        client.press("Start")
        client.receive_until(lambda message: "Glb" in message["type"])
        client.receive_until(lambda message: "Click the object to mark it" in str(message))
        client.give_up()
        client.receive_until(lambda message: "is stored" in str(message))
    assert_no_answer(client, dataset)


def test_an_agent_gets_task_and_senses_only(marked_dataset: Path) -> None:
    dataset = PersonalDataset(marked_dataset)
    scene = open_scene(dataset, "Marked")
    renderer = Raycaster(scene.mesh)
    for episode in dataset.episodes():
        told = dataclasses.asdict(episode.task("pan"))
        assert set(told) == {"kind", "description", "queries", "max_steps", "actions"}
        assert CANARY not in str(told)
        assert not any(target.object_name in str(told) for target in episode.targets)
    env = PanEnv(episode.start, scene.navigation, renderer=renderer)
    seen = env.step(Action.LEFT)
    fields = {field.name for field in dataclasses.fields(seen)}
    assert fields == {"rgb", "depth_m", "gps", "compass", "T_start_camera", "camera", "collided", "step"}
