"""Plug-ins that a user names as package.module:factory: how they are found or refused, and what their digest covers."""

import sys
from pathlib import Path

import pytest

from sim.errors import AgentError
from sim.plugins import build_plugin, is_plugin, plugin_digest


@pytest.mark.parametrize("name", ["mine:make", "a.b_c.d:Make", "mine:Group.make"])
def test_package_module_and_factory_name_a_plug_in(name: str) -> None:
    assert is_plugin(name)


@pytest.mark.parametrize("name", ["mine", "mine:", ":make", "a/b:make", "C:\\models", "mine:make()", "a b:c", ""])
def test_other_names_are_refused(name: str) -> None:
    assert not is_plugin(name)
    with pytest.raises(AgentError, match=r"--agent is .*; expected your own as package.module:factory"):
        build_plugin(name, option="--agent")


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The current folder, with a package of the user."""
    before = set(sys.modules), list(sys.path)
    (tmp_path / "own_pack").mkdir()
    (tmp_path / "own_pack" / "__init__.py").write_text("")
    (tmp_path / "own_pack" / "agent.py").write_text(
        "import json\nfrom .words import WORDS\nfrom sim.types import Action\n"
    )
    (tmp_path / "own_pack" / "words.py").write_text("import own_deep\nWORDS = 1\n")
    (tmp_path / "own_pack" / "other.py").write_text("X = 1\n")
    (tmp_path / "own_deep.py").write_text("Y = 1\n")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in set(sys.modules) - before[0]:
        del sys.modules[name]
    sys.path[:] = before[1]


def test_the_digest_covers_the_module_and_the_modules_that_it_imports_from_its_folder(own_folder: Path) -> None:
    first = plugin_digest("own_pack.agent:make")
    assert len(first) == 16
    for name, is_part in (("own_pack/other.py", False), ("own_pack/words.py", True), ("own_deep.py", True)):
        before = (own_folder / name).read_text()
        (own_folder / name).write_text(before + "Z = 2\n")
        assert (plugin_digest("own_pack.agent:make") != first) == is_part
        (own_folder / name).write_text(before)
    assert plugin_digest("own_pack.agent:make") == first


def test_a_plug_in_that_cannot_be_found_or_built_is_refused_in_one_line(own_folder: Path) -> None:
    (own_folder / "own_bad.py").write_text(
        "def make():\n    raise OSError('no weights')\n\n\ndef nothing():\n    return 1\n"
    )
    with pytest.raises(AgentError, match="own_bad:make: OSError while it was built: no weights"):
        build_plugin("own_bad:make")
    lacking = r"own_bad:nothing: found no method act\(\); expected one, because --agent needs it"
    with pytest.raises(AgentError, match=lacking):
        build_plugin("own_bad:nothing", option="--agent", methods=("act",))
    with pytest.raises(AgentError, match="ModuleNotFoundError"):
        build_plugin("own_nowhere:make")
    with pytest.raises(AgentError, match="own_nowhere:make: "):
        plugin_digest("own_nowhere:make")
