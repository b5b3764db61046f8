"""Options that no run or study can have end in one line, and names made from options always fit."""

import random
import re
from pathlib import Path

import pytest

from personal_viz.cli.verbs import options_of, parse
from sim.tasks.run_files import MAX_NAME, RUN_ID, fitting_name, fitting_run_id, read_run

from .program import assert_one_line, personal_viz

ODD = ["x" * 200, "über alles", "../up", ".hidden", "a/b:c", "", "tab\there", "-", "\x1b[31mred", "ok-1.2_3", "Ж" * 100]


@pytest.mark.parametrize("name", ODD)
def test_any_name_can_be_made_the_name_of_a_folder(name: str) -> None:
    assert re.fullmatch(RUN_ID, fitting_run_id(name))
    assert len(fitting_name(name)) <= MAX_NAME
    assert fitting_run_id("shortest-path-schematic-seed0") == "shortest-path-schematic-seed0"
    assert fitting_run_id("a" * 80 + "b") != fitting_run_id("a" * 80 + "c")


@pytest.mark.slow
def test_run_names_itself_whatever_the_agent_is_called(
    invented_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "agent_" + "long_" * 15
    (tmp_path / f"{module}.py").write_text(
        "from sim.tasks.agents import RandomAgent\n\n\ndef make(**_):\n    return RandomAgent()\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    same = ["run", "--dataset", invented_root, "--scene", "Small", "--split", "easy", "--limit", 1, "--out", tmp_path]
    done = personal_viz(*same, "--agent", f"{module}:make", "--seed", 10**12)
    assert (done.returncode, done.stderr) == (0, "")
    (made,) = tmp_path.glob("*/run.json")
    assert re.fullmatch(RUN_ID, made.parent.name)
    assert len(read_run(made.parent).info.who) == MAX_NAME


@pytest.mark.slow
def test_random_names_are_accepted_or_refused_in_one_line(invented_root: Path, tmp_path: Path) -> None:
    draw = random.Random(7)
    taken = 0
    for number in range(60):
        name = draw.choice(ODD)
        out = tmp_path / str(number)
        init = ["study", "init", out, "--dataset", invented_root]
        arguments = draw.choice([
            [*init, "--name", name],
            [*init, "--per-split", draw.choice([-3, 0, 2, 10**30]), "--seed", draw.choice([-1, 0, 10**30])],
            ["import", "no.jsonl", "--dataset", invented_root, "--who", name, "--run-id", draw.choice(ODD)],
            ["ground", "--dataset", invented_root, "--method", "qs", "--run-id", name, "--limit", 1, "--out", out],
            ["run", "--dataset", invented_root, "--agent", name, "--run-id", draw.choice(ODD), "--out", out],
        ])  # fmt: skip
        done = personal_viz(*arguments)
        assert done.returncode in (0, 1), (arguments, done.stderr)
        assert len(done.stderr.splitlines()) == done.returncode, (arguments, done.stderr)
        assert "\x1b" not in done.stderr
        taken += done.returncode == 0
    assert 5 < taken < 55


def test_the_line_names_the_option_that_a_file_refused(invented_root: Path, tmp_path: Path) -> None:
    same = ["study", "init", tmp_path / "a study, with a long name and blanks", "--dataset", invented_root]
    done = personal_viz(*same, "--name", "two words")
    assert_one_line(done, "personal-viz: --name: study is 'two words'; expected: ")
    assert done.stderr.endswith("Give another --name.\n")
    assert personal_viz(*same).returncode == 0  # the folder's name is made to fit
    assert "study: a-study-with-a-long-name-and-bla" in (tmp_path / same[2] / "study.yaml").read_text()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("plan x", "personal-viz: found 'plan', which is no command. Did you mean 'study plan'?"),
        ("validat x", "personal-viz: found 'validat', which is no command. Did you mean 'validate'?"),
        ("study withdrw pan p02", "personal-viz study: found 'withdrw', which is no command. Did you mean 'withdraw'?"),
        ("run --agnt random", "personal-viz run: found '--agnt', which is no option. Did you mean '--agent'?"),
        ("study serve x --publc", "found '--publc', which is no option. Did you mean '--public'?"),
        ("stats --no-jsn", "found '--no-jsn', which is no option. Did you mean '--no-json'?"),
        ("run --split=Easi", "found 'Easi', which is no value of --split. Did you mean 'easy'?"),
        ("run --split easy mediun", "found 'mediun', which is no value of --split. Did you mean 'medium'?"),
        ("bench --quick simm", None),
        ("bench simm", "personal-viz bench: found 'simm', which is no value here. Did you mean 'sim'?"),
    ],
)
def test_a_word_that_is_nearly_known_is_one_line(
    words: str, line: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(words.split())
    said = capsys.readouterr().err
    assert ended.value.code == 2
    if line is not None:
        assert line in said
        assert said.count("\n") == 1


def test_a_value_that_is_like_a_choice_of_another_option_is_taken() -> None:
    verb = parse(["generate", "data", "--scenes", "Llm", "--describe", "llm", "--out", "llm_out"])
    assert (vars(verb)["describe"], vars(verb)["out"]) == ("llm", Path("llm_out"))


@pytest.mark.parametrize("name", ["run", "study serve", "generate"])
def test_every_option_of_the_help_is_known(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse([*name.split(), "--help"])
    options = set(re.findall(r"^\W+(--[a-z][a-z-]*)", capsys.readouterr().out, re.MULTILINE))
    assert len(options) > 10
    assert options <= set(options_of(name))
