"""`ground --sequences`: who owns what follows messages; known answers, refusals, resumed runs, and their table."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from grounding.encoders.protocol import TextEncoder
from grounding.evaluation.sequences import SequenceGroundJob, open_job, true_phrases
from grounding.evaluation.settings import GroundSettings
from grounding.maps.home_map import Memory, MemoryKind
from grounding.phrases.ownership_text import asked_thing
from grounding.types import Candidate, Grounding
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.verbs import parse
from sim.episodes.sequence_files import HomeSequence
from sim.errors import AgentError, PersonalVizError, RunFileError
from sim.sequences.figures import sequence_figures
from sim.sequences.runs import SEQUENCES_FILE, SequenceRun, read_sequence_runs
from sim.sequences.searches import sequence_key
from sim.tasks.chat_turns import read_turns
from sim.tasks.run_files import read_run_info
from sim.types import Task
from tests.sim.home_story import MESSAGES, SCENE, SUBTASKS, told_in

from .chat_stub import chat_stub

THINGS = {
    "towel_7": "a green and beige plaid towel located above the red enamel bathtub",
    "armchair_35": "an armchair",
    "armchair_50": "a pink velvet armchair near the green and white striped curtain",
    "bed_11": "a bed with a pink and white floral cover next to the teal wooden nightstand",
    "bed_46": "a bed with a teal and white floral cover next to the blue wooden nightstand",
}
"""Words of the story's objects."""
SENTENCES = [f"{owner} owns {THINGS[name]}" for owner, name in MESSAGES[0]["adds"]]
SAID = [
    {**MESSAGES[0], "text": ". ".join(SENTENCES), "extracted_summary": SENTENCES},
    {**MESSAGES[1], "text": f"Ada gave Bo {THINGS['armchair_35']}."},
    {**MESSAGES[2], "text": f"Ada gave Bo {THINGS['bed_11']}; in return, Bo gave Ada {THINGS['bed_46']}."},
]
"""The story in words that rules know, with one sentence per edge of the intro."""
PLACES = dict[str, tuple[float, float, float]]()
"""Where the thing of each text is; the fixture `told` fills it."""


class Knower:
    """A grounder that knows where each thing is, and nothing of who owns it but the phrases."""

    name, uses_phrases, frame = "knower", True, "the things of the story"
    takes: MemoryKind = "grid"

    def __init__(self, encoder: TextEncoder) -> None:
        self._encoder = encoder

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """The place of the thing that the query means; none where the phrases do not say it."""
        asked = asked_thing(phrases, task.queries[0], self._encoder)
        place = None if asked is None else PLACES.get(asked.texts[asked.chosen])
        return Grounding(() if place is None else (Candidate(place, 1.0, 0, 0, 0),))


KNOWER = f"{__name__}:Knower"


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """A set of one sequence."""
    out = tmp_path_factory.mktemp("set")
    sequence = told_in(small_home_root, out, messages=SAID, subtasks=SUBTASKS)
    PLACES.update({THINGS[goal.object_name]: goal.position for goal in sequence.goals if goal.object_name in THINGS})
    return out, sequence


def answered(root: Path, told: tuple[Path, HomeSequence], method: str, **more: bool) -> SequenceRun:
    """The run of the story with true phrases on the oracle map."""
    key = sequence_key(told[1])
    settings = GroundSettings(method=method, encoder="hashed", phrases="dataset")
    return open_job(SequenceGroundJob(root, SCENE, (key,), settings, sequences=told[0], **more))(key).run


def test_true_phrases_follow_the_ownership(told: tuple[Path, HomeSequence]) -> None:
    tables = [set(true_phrases(told[1], search)) for search in range(6)]
    assert tables[0] == tables[1] == set(SENTENCES)
    assert tables[2] - tables[1] == {"Bo owns an armchair"}
    assert tables[1] - tables[2] == {"Ada owns an armchair"}
    assert tables[3] - tables[2] == {f"Ada owns {THINGS['bed_46']}", f"Bo owns {THINGS['bed_11']}"}
    assert tables[3] == tables[4] == tables[5]


@pytest.mark.parametrize("method", [KNOWER, "joint"])
def test_with_true_phrases_every_kind_is_right(
    small_home_root: Path, told: tuple[Path, HomeSequence], method: str
) -> None:
    """In the search for all of two armchairs a grounder marks one."""
    run = answered(small_home_root, told, method)
    figures = sequence_figures([run])
    assert [search.succeeds("paper") for search in run.end.searches] == [True, False, True, True, True, True]
    assert (figures.sr_fresh, figures.sr_revisit, figures.sr_changed, figures.sr_stale) == (0.5, 1, 1, 1)
    assert (figures.stale, figures.lag, figures.recall, figures.precision) == (0, 0, 0.5, 1)


def test_without_messages_what_changed_is_wrong_and_the_old_object_is_taken_for_it(
    small_home_root: Path, told: tuple[Path, HomeSequence]
) -> None:
    figures = sequence_figures([answered(small_home_root, told, KNOWER, ignores_messages=True)])
    assert (figures.sr_fresh, figures.sr_revisit, figures.sr_changed, figures.sr_stale) == (0.5, 1, 0, 0)
    assert figures.stale == 1


def test_an_intro_without_a_sentence_for_each_edge_has_no_true_phrases(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path
) -> None:
    plain = told_in(small_home_root, tmp_path, messages=MESSAGES, subtasks=SUBTASKS)
    with pytest.raises(AgentError, match=r"0 sentences for 5 edges; expected one each .* Give --phrases rules"):
        answered(small_home_root, (tmp_path, plain), KNOWER)


def ground(root: Path, told: Path, out: Path, *more: str) -> None:
    words = ["ground", "--dataset", str(root), "--sequences", str(told), "--method", KNOWER, "--out", str(out)]
    assert parse([*words, *more]).run() == 0


def test_rows_of_metrics_show_what_messages_change(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """True phrases never stand alone: rules read the same."""
    for more in ((), ("--ignore-messages",)):
        ground(small_home_root, told[0], tmp_path, *more)
    assert "hashed encoder, phrases rules, storey given): interference +50.0 points" in capsys.readouterr().out
    assert Metrics((tmp_path,), json=True).run() == 0
    rows = {row["condition"]: row for row in json.loads(capsys.readouterr().out)}
    hears, ignores = "oracle map, hashed encoder, phrases", "messages ignored, oracle map, hashed encoder, phrases"
    ends = (" dataset, storey given", " rules, storey given")
    assert set(rows) == {start + end for start in (hears, ignores) for end in ends}
    for row in rows.values():
        assert (row["task"], row["goat_measures"], row["memory_gain"]) == ("pog", None, None)
        assert row["sequence_measures"]["n"] == 1
    wanted = {hears: (1, 1, 0), ignores: (0, 0, 1)}
    for start, figures in wanted.items():
        for end in ends:
            found = rows[start + end]["sequence_measures"]
            assert (found["sr_changed"], found["sr_stale"], found["stale"]) == figures
            assert (found["sr_fresh"], found["sr_revisit"], found["spl"]) == (0.5, 1, None)


def test_a_cut_run_is_resumed_and_another_kind_of_run_does_not_go_on_in_its_folder(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two = tmp_path / "two"
    told_in(small_home_root, two, messages=SAID, subtasks=SUBTASKS)
    options = ("--run-id", "mine", "--phrases", "rules")
    ground(small_home_root, two, tmp_path / "runs", *options)
    folder = tmp_path / "runs" / "mine"
    assert {path.name for path in folder.parent.iterdir()} == {"mine"}
    assert read_run_info(folder).config["ignore_messages"] is False
    file = folder / SEQUENCES_FILE
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    ground(small_home_root, two, tmp_path / "runs", *options)
    assert file.read_bytes() == whole
    ground(small_home_root, two, tmp_path / "runs", *options)
    assert file.read_bytes() == whole, "nothing is answered twice"
    with pytest.raises(RunFileError, match="expected the same to resume"):
        ground(small_home_root, two, tmp_path / "runs", *options, "--ignore-messages")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--shard", "1/2"), "--shard beside --sequences: expected one of them"),
        (("--sweep", "blur=0,1"), "--sweep beside --sequences: expected one of them"),
        (("--study", "somewhere"), "somewhere/study.yaml: cannot be read"),
        (("--split", "easy"), "the chosen splits and scenes hold no episode"),
        (("--scene", "Smal"), "found no scene 'Smal'"),
    ],
)
def test_options_that_do_not_belong_to_sequences_are_refused(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, more: tuple[str, ...], message: str
) -> None:
    with pytest.raises(PersonalVizError, match=message):
        ground(small_home_root, told[0], tmp_path / "runs", *more)
    assert not (tmp_path / "runs").exists()


def test_ignoring_messages_without_sequences_is_refused(small_home_root: Path) -> None:
    words = ["ground", "--dataset", str(small_home_root), "--method", "qs", "--ignore-messages"]
    with pytest.raises(PersonalVizError, match="--ignore-messages: found no --sequences"):
        parse(words).run()


def test_a_model_that_reads_texts_is_asked_once_per_text_and_the_run_keeps_it(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It gets what was told until then, and nothing of later searches, of answers, or of who owned what before."""
    pytest.importorskip("openai", reason="extra llm is not installed")
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    with chat_stub() as stub:
        stub.content = json.dumps({"ownership": [{"owner": "Cy", "object": THINGS["towel_7"]}]})
        model = ("--phrases", "llm", "--llm-url", stub.url, "--llm-model", "small", "--run-id", "asked")
        ground(small_home_root, told[0], tmp_path, *model)
    texts = [message["text"] for message in SAID]
    sent = [request["messages"][1]["content"] for request in stub.requests]
    assert sent == ["\n".join(texts[:count]) for count in (1, 2, 3)]
    turns = list(read_turns(tmp_path / "asked"))
    assert {turn.key for turn in turns} == {sequence_key(told[1])}
    assert len(turns) == 6
    (run,) = read_sequence_runs(tmp_path / "asked")
    assert [search.reason for search in run.end.searches] == ["found", *3 * ["giveup"], "found", "giveup"]
