"""Agents, encoders, methods and phrases of a user on the command line: names, labels, changed code."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from personal_viz.cli.grounding.ground import Ground
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.run import Run
from sim.errors import AgentError, DatasetError, RunFileError
from sim.tasks.run_files import read_run, read_run_info

AGENT = """
from sim.types import Action

class Turner:
    name = "turner"

    def reset(self, task, camera, *, seed, keep_memory=False):
        self.left = 2

    def act(self, observation):
        self.left -= 1
        return Action.LEFT if self.left else Action.STOP
"""
ENCODER = """
from grounding.encoders.hashed import HashedWords

class Words(HashedWords):
    name = "my-words-768"
"""
GROUNDER = """
from grounding.methods.baselines import MapCentre

class Middle(MapCentre):
    name = "my-middle"

def make(encoder):
    assert encoder.dim
    return Middle()
"""
PHRASES = """
class Nobody:
    name, num_fallbacks = "nobody", 0

    def phrases(self, task):
        return ("Nobody owns the lamp",)
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, with plug-ins."""
    before = set(sys.modules), list(sys.path)
    for name, text in (("agent", AGENT), ("words", ENCODER), ("middle", GROUNDER), ("nobody", PHRASES)):
        (tmp_path / f"own_{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in set(sys.modules) - before[0]:
        if name.startswith("own_"):
            del sys.modules[name]
    sys.path[:] = before[1]


def change(file: Path) -> None:
    """Changes a plug-in; it is loaded again as in a new process."""
    file.write_text(file.read_text() + "\nVERSION = 2\n")
    sys.modules.pop(file.stem, None)
    importlib.invalidate_caches()


@pytest.mark.slow
def test_a_run_is_named_after_the_agent_and_its_versions_can_share_a_table(
    own: Path, small_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"dataset": small_root, "agent": "own_agent:Turner", "limit": 1, "split": ("easy",)}
    assert Run(**options).run() == 0
    (folder,) = (own / "runs").iterdir()
    assert folder.name.startswith("turner-")
    info = read_run_info(folder)
    assert info.who == "turner"
    assert str(info.config["agent_code"]).startswith("own_agent:Turner@")
    assert Run(**options).run() == 0
    assert "1 done before" in capsys.readouterr().out
    change(own / "own_agent.py")
    with pytest.raises(
        RunFileError, match=r"was made with other code of your agent; expected the same .* --label NAME"
    ):
        Run(**options).run()
    assert Run(**options, label="turner-2").run() == 0
    assert Metrics(tuple((own / "runs").iterdir()), json=True).run() == 0
    printed = capsys.readouterr().out
    rows = json.loads(printed[printed.index("[\n") :])
    assert {row["who"] for row in rows} == {"turner", "turner-2"}


@pytest.mark.slow
def test_ground_accepts_an_encoder_a_method_and_phrases_of_the_user(own: Path, small_root: Path) -> None:
    assert Ground(small_root, "qs", encoder="own_words:Words", limit=1).run() == 0
    (folder,) = (own / "runs").iterdir()
    assert folder.name == "ground-qs-oracle-my-words-768-storey-given-seed0"
    info = read_run_info(folder)
    assert info.config["encoder"] == "my-words-768"
    assert "my-words-768 encoder" in info.condition
    plain = Ground(small_root, "qs", limit=1, run_id="plain")
    assert plain.run() == 0
    assert read_run(own / "runs" / "plain").answers == read_run(folder).answers
    change(own / "own_words.py")
    from grounding.encoders import by_name

    by_name._plugin.cache_clear()
    with pytest.raises(RunFileError, match="other code of your encoder"):
        Ground(small_root, "qs", encoder="own_words:Words", limit=1).run()
    assert Ground(small_root, "own_middle:make", limit=1, run_id="middle").run() == 0
    assert read_run_info(own / "runs" / "middle").who == "my-middle"
    assert Ground(small_root, "joint", phrases="own_nobody:Nobody", limit=1, run_id="nobody").run() == 0
    assert read_run_info(own / "runs" / "nobody").config["phrases"] == "nobody"


def test_the_encoder_name_in_map_files_is_accepted_too(own: Path, small_root: Path) -> None:
    assert Ground(small_root, "qs", encoder="hashed-words-768", limit=1).run() == 0
    (folder,) = (own / "runs").iterdir()
    assert read_run_info(folder).config["encoder"] == "hashed"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "qz"}, "--method is 'qz'; expected random, center, qs, .* or your own as package.module:factory"),
        ({"method": "own_nowhere:make"}, "own_nowhere:make: ModuleNotFoundError while it was built"),
        ({"encoder": "own_middle:make"}, "own_middle:make: TypeError while it was built"),
        ({"encoder": "own_nobody:Nobody"}, r"own_nobody:Nobody: found no method encode_texts\(\)"),
        ({"encoder": "wordz"}, "encoder 'wordz': is not known; expected hashed, minilm, .* or your own as"),
        ({"phrases": "own_words:Words"}, r"own_words:Words: found no method phrases\(\)"),
        ({"phrases": "rulez"}, "--phrases is 'rulez'; expected dataset, rules, llm, or your own"),
    ],
)
def test_a_wrong_plug_in_is_refused_in_one_line_before_anything_is_written(
    own: Path, small_root: Path, options: dict[str, str], message: str
) -> None:
    with pytest.raises(AgentError, match=message) as caught:
        Ground(**{"dataset": small_root, "method": "joint", **options}).run()
    assert "\n" not in str(caught.value)
    assert not (own / "runs").exists()


def test_an_episode_can_be_named_by_text(small_root: Path) -> None:
    from sim import Dataset

    dataset = Dataset(small_root)
    key = next(dataset.episodes()).key
    assert dataset.episode(str(key)).key == key
    with pytest.raises(DatasetError, match="episode: found 'nonsense'; expected SPLIT/SCENE/ID"):
        dataset.episode("nonsense")
