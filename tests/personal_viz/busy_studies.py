"""A study in the middle of its collection, with people in every state, for tests and pictures of the dashboard."""

from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.design.planning import make_plan
from human_study.design.secrets import token_hash
from human_study.store.store import StudyStore, open_store
from human_study.trial.events import Error, Moment, Shown
from personal_viz.study_app.operator.progress_view import Serving, ShownWorker
from sim.tasks.run_files import EpisodeEnd
from sim.types import SPLITS, EpisodeKey
from tests.human_study.small_world import study
from tests.human_study.stores import OPEN

SERVING = Serving(
    (ShownWorker(1, "serving", 3), ShownWorker(2, "starting", 0)), frozenset({"p01", "p02", "p03", "p05", "p06"})
)


def busy_study(folder: Path, *, num_homes: int = 4) -> StudyStore:
    """Homes with an episode in each split, and people who are at different places."""
    config = study(
        study="kitchens-2026",
        task=("pan",),
        design={"kind": "house-once", "raters_per_episode": 2, "trials_per_person": num_homes, "overbook": 1.5},
        memory={"arms": ("none", "topdown")},
        flow=("device", "consent", "instructions", "quiz"),
    )
    homes = [StudyScene(name=f"H{n:02d}", kind="invented") for n in range(num_homes)]
    keys = [EpisodeKey(split, home.name, "0") for home in homes for split in SPLITS]
    plan = make_plan(config, homes, keys, is_pilot=True)
    store = open_store(folder, config, plan)
    for person in plan.participants:
        store.add_participant(person, token_hash(person.code))
    _arrive(store)
    return store


def do_trials(store: StudyStore, code: str, count: int, *, reason: str = "giveup") -> None:
    """Does `count` of the participant's next trials, all with the same end."""
    for _ in range(count):
        place = store.next_trial(code)
        assert place is not None
        trial = store.open_trial(code, place.order_no)
        end = Error(message="renderer died", is_fatal=True) if reason == "technical" else Moment(kind="giveup")
        store.append_many(trial.trial_id, trial.epoch, [OPEN, Shown(step=0, frame_hash=None), end])
        store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason))  # type: ignore[arg-type]


def begin_trial(store: StudyStore, code: str) -> None:
    """The participant's next trial, up to its first picture."""
    place = store.next_trial(code)
    assert place is not None
    trial = store.open_trial(code, place.order_no)
    store.append_many(trial.trial_id, trial.epoch, [OPEN, Shown(step=0, frame_hash=None)])


def _arrive(store: StudyStore) -> None:
    for code, count in (("p01", 2), ("p02", 1), ("p03", 3), ("p04", 2)):
        _pass(store, code, "arrived", "device_ok", "consented", "instructed", "quiz_passed")
        do_trials(store, code, count)
    do_trials(store, "p02", 1, reason="technical")
    begin_trial(store, "p01")
    begin_trial(store, "p02")
    store.enter_stage("p03", "break_started", {"done": 3})
    store.withdraw("p04")
    _pass(store, "p05", "arrived", "device_ok")
    _pass(store, "p06", "arrived", "device_ok", "consented", "instructed")


def _pass(store: StudyStore, code: str, *stages: str) -> None:
    for stage in stages:
        if stage == "consented":
            store.give_consent(code, "text", given=True)
        else:
            store.enter_stage(code, stage)  # type: ignore[arg-type]
