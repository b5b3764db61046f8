"""A study in the middle of its collection, with people in every state, for tests and pictures of the dashboard."""

from pathlib import Path

from human_study.store.store import StudyStore
from personal_viz.study_app.operator.progress_view import Serving, ShownWorker
from sim.types import SPLITS
from tests.human_study.small_world import study
from tests.human_study.stores import begin_next, do_next, open_planned, plan_homes

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
    drawn = plan_homes(config, [f"H{n:02d}" for n in range(num_homes)], splits=SPLITS, is_pilot=True)
    store = open_planned(folder, config, drawn)
    _arrive(store)
    return store


def _arrive(store: StudyStore) -> None:
    for code, count in (("p01", 2), ("p02", 1), ("p03", 3), ("p04", 2)):
        _pass(store, code, "arrived", "device_ok", "consented", "instructed", "quiz_passed")
        for _ in range(count):
            do_next(store, code)
    do_next(store, "p02", reason="technical")
    begin_next(store, "p01")
    begin_next(store, "p02")
    store.enter_stage("p03", "break_started", {"done": 3})
    store.withdraw("p04")
    _pass(store, "p05", "arrived", "device_ok")
    _pass(store, "p06", "arrived", "device_ok", "consented", "instructed")


def _pass(store: StudyStore, code: str, *stages: str) -> None:
    for stage in stages:
        if stage == "consented":
            store.give_consent(code, "text", given=True)
        else:
            store.enter_stage(code, stage)
