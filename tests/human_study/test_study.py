"""The frozen study file, the plan, tokens and events as text."""

import json
from pathlib import Path

import pytest

from human_study.events import EVENT_KINDS, Act, Clicked, Event, event_from_json, event_to_json
from human_study.plan import load_plan, make_plan, save_plan
from human_study.study import StudyCamera, StudyConfig, StudyScene, load_study, save_study
from human_study.tickets import new_id, new_token, token_hash, token_matches
from sim.errors import StudyError
from sim.types import Action, Camera

from .small_world import episode, plan, study
from .test_session import RAY

KEYS = [episode(str(number)).key for number in range(20)]


def test_the_study_version_is_the_hash_of_what_was_chosen() -> None:
    # sha256 of {"dataset_digest":"<64 zeros>","scenes":[{"kind":"invented","name":"room"}],"study":"pilot"}
    assert study().study_version == "728ec81f65df7527a194c9bdd71c687d69bd2947c5a1cee572c3a76de271c279"
    assert study(seed=0).study_version == study().study_version
    assert study(seed=1).study_version != study().study_version


def test_a_field_of_a_later_version_leaves_running_studies_alone() -> None:
    class LaterConfig(StudyConfig):
        breaks_every: int = 10

    values = study().model_dump()
    assert LaterConfig(**values).study_version == study().study_version
    assert LaterConfig(**values, breaks_every=5).study_version != study().study_version


def test_a_study_file_comes_back_as_it_was_and_is_never_replaced(tmp_path: Path) -> None:
    config = study(camera=StudyCamera(width=320, height=240), actions="paper6")
    path = save_study(tmp_path, config)
    assert load_study(tmp_path) == config
    assert save_study(tmp_path, config) == path
    with pytest.raises(StudyError, match="A study never changes"):
        save_study(tmp_path, study(seed=9))
    assert load_study(tmp_path) == config
    assert config.robot_camera == Camera(320, 240, 79.0, 0.88)
    assert Action.LOOK_UP in config.action_set


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 3}, "steps is 3; expected: Extra inputs are not permitted"),
        ({"max_steps": 501}, "max_steps is 501; expected: Input should be less than or equal to 500"),
        ({"actions": "all"}, "actions is 'all'; expected: Input should be 'paper4' or 'paper6'"),
        ({"study": "../up"}, "study is '../up'"),
        ({"tasks": ["pan", "pan"]}, "each of tasks once"),
    ],
)
def test_a_bad_study_file_names_the_field(tmp_path: Path, change: dict[str, object], message: str) -> None:
    values = json.loads(study().model_dump_json()) | change
    (tmp_path / "study.json").write_text(json.dumps(values))
    with pytest.raises(StudyError) as caught:
        load_study(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_without_a_study_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="personal-viz study init"):
        load_study(tmp_path)


def test_participants_see_the_studys_query_and_limits() -> None:
    task = study(query_index=1, max_steps=7).task_for(episode(), "pan")
    assert (task.queries, task.max_steps, len(task.actions)) == (("Where is it?",), 7, 4)
    with pytest.raises(StudyError, match="has 2 queries; expected 0 to 1"):
        study(query_index=2).task_for(episode(), "pan")


def test_everybody_gets_the_same_episodes_in_an_own_order() -> None:
    people = make_plan(study(), KEYS, ("pog", "pan"), limit=8).participants
    orders = [[trial.key for trial in person.trials] for person in people]
    assert [person.code for person in people] == ["p01", "p02"]
    assert [{trial.task for trial in person.trials} for person in people] == [{"pog"}, {"pan"}]
    assert [trial.order_no for trial in people[0].trials] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert sorted(orders[0]) == sorted(orders[1])
    assert orders[0] != orders[1]
    assert len(set(orders[0])) == 8


def test_the_plan_follows_from_the_seed_alone() -> None:
    first = make_plan(study(), KEYS, ("pog", "pan"), limit=5)
    assert make_plan(study(), KEYS[::-1], ("pog", "pan"), limit=5) == first
    assert make_plan(study(seed=1), KEYS, ("pog", "pan"), limit=5).participants != first.participants


def test_a_plan_comes_back_as_it_was_and_belongs_to_one_study(tmp_path: Path) -> None:
    save_plan(tmp_path, plan(study()))
    assert load_plan(tmp_path, study()) == plan(study())
    with pytest.raises(StudyError, match="Make the plan again for this study"):
        load_plan(tmp_path, study(seed=1))


@pytest.mark.parametrize(
    ("keys", "people", "limit", "message"),
    [
        ([], ("pan",), None, "found 0 episodes"),
        ([KEYS[0], KEYS[0]], ("pan",), None, "found 2 episodes, 1 of them different"),
        ([KEYS[0]._replace(scene="barn")], ("pan",), None, "scene is 'barn'; expected one of: room"),
        (KEYS, ("pog",), None, "a participant's task is 'pog'"),
        (KEYS, ("pan",), 21, "limit is 21; expected 1 to 20"),
        (KEYS, ("pan",), 0, "limit is 0; expected 1 to 20"),
    ],
)
def test_an_impossible_plan_is_refused(keys: list, people: tuple, limit: int | None, message: str) -> None:
    with pytest.raises(StudyError, match=message):
        make_plan(study(tasks=("pan",)), keys, people, limit=limit)


def test_a_study_may_mix_scene_kinds_and_knows_which_is_which() -> None:
    config = study(scenes=(StudyScene(name="a", kind="scan"), StudyScene(name="b", kind="invented")))
    assert (config.scene_kind("a"), config.scene_kind("b")) == ("scan", "invented")


def test_tokens_are_128_bit_and_match_only_their_own_hash() -> None:
    token = new_token()
    assert len(token) == 22
    assert token_hash("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert token_matches("abc", token_hash("abc"))
    assert not token_matches("abd", token_hash("abc"))


def test_ids_are_26_safe_characters_in_order_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.time_ns", lambda: 1_469_918_176_385 * 10**6)
    first = new_id()
    monkeypatch.setattr("time.time_ns", lambda: 1_469_918_176_386 * 10**6)
    assert first.startswith("01ARYZ6S41")  # the example of the ULID specification
    assert len(first) == 26
    assert first < new_id()


@pytest.mark.parametrize(
    "event",
    [
        Act(action=Action.FORWARD, position=(0.1, 1e-300, -1 / 3), yaw=0.1 + 0.2, collided=True, t_s=1.0),
        Clicked(ray=RAY, hit=None, t_cli_ms=12.25),
        Clicked(ray=RAY, hit=(1.0, 2.0, 3.0)),
    ],
)
def test_an_event_comes_back_as_it_was(event: Event) -> None:
    assert event_from_json(event_to_json(event)) == event


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "found text that is not JSON|is text that is not JSON"),
        ("[]", "expected"),
        ('{"kind": "teleport"}', "kind is 'teleport'; expected one of open, shown, key"),
        ('{"code": "KeyW"}', "kind is None; expected one of open"),
        ('{"kind": "key", "code": "KeyW", "action": "fly"}', "action is 'fly'"),
        ('{"kind": "key", "code": "KeyW", "action": "stop", "goal": 1}', "goal is 1"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, NaN], "yaw": 0}', "expected"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, 1e999], "yaw": 0}', "finite number"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, "1"], "yaw": 0}', "position.2 is '1'"),
    ],
)
def test_text_that_is_no_event_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(StudyError, match=message) as caught:
        event_from_json(text, where="study.db: T1/4")
    assert str(caught.value).startswith("study.db: T1/4: ")
    assert "\n" not in str(caught.value)


def test_the_list_of_events_is_closed_and_named_once() -> None:
    assert len(set(EVENT_KINDS)) == len(EVENT_KINDS) == 15


def test_studies_and_plans_as_version_1_wrote_them_still_read_and_newer_ones_are_refused(tmp_path: Path) -> None:
    text = (
        '{"schema_version":1,"study":"pilot","dataset_digest":"' + "0" * 64 + '","scenes":[{"name":"room",'
        '"kind":"invented"}],"tasks":["pan","pog"],"actions":"paper4","max_steps":500,"query_index":0,'
        '"resume_within_s":600.0,"seed":0,"camera":{"width":640,"height":480,"hfov_deg":79.0,"mount_height":0.88}}'
    )
    planned = (
        '{"schema_version":1,"study_version":"728ec81f65df7527a194c9bdd71c687d69bd2947c5a1cee572c3a76de271c279",'
        '"participants":[{"code":"p01","trials":[{"order_no":1,"task":"pan","split":"easy","scene":"room",'
        '"episode_id":"1"}]}]}'
    )
    (tmp_path / "study.json").write_text(text)
    (tmp_path / "plan.json").write_text(planned)
    assert load_study(tmp_path) == study()
    assert load_plan(tmp_path, study()) == make_plan(study(), [episode("1").key], ("pan",))
    (tmp_path / "plan.json").write_text(planned.replace('"schema_version":1', '"schema_version":2'))
    with pytest.raises(StudyError, match=r"plan\.json: schema_version is 2; expected"):
        load_plan(tmp_path, study())
    (tmp_path / "study.json").write_text(text.replace('"schema_version":1', '"schema_version":2'))
    with pytest.raises(StudyError, match=r"study\.json: schema_version is 2; expected"):
        load_study(tmp_path)
