"""In which order people get what was given back: their own as planned, others' easy and hard ones mixed."""

from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.design.planning import make_plan
from human_study.design.secrets import token_hash
from human_study.store.store import StudyStore, open_store
from sim.types import SPLITS, EpisodeKey

from .small_world import study
from .test_assigning import do_next

HOMES = tuple("ABCDEFGHIJKL")


def started(folder: Path) -> StudyStore:
    """Twelve homes with an episode in each split; p01 to p03 do one episode of each home and p04 is spare."""
    config = study(task=("pan",), design={"kind": "house-once", "raters_per_episode": 1, "overbook": 1.3})
    homes = [StudyScene(name=home, kind="invented") for home in HOMES]
    plan = make_plan(config, homes, [EpisodeKey(split, home, "0") for home in HOMES for split in SPLITS])
    store = open_store(folder, config, plan)
    for person in plan.participants:
        store.add_participant(person, token_hash(person.code))
    return store


def test_who_comes_back_goes_on_in_the_order_of_the_plan(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        planned = [trial.key for trial in store.plan.participant("p01").trials]
        done = [do_next(store, "p01") for _ in range(3)]
        store.drop_out("p01", "away")
        done += [do_next(store, "p01") for _ in range(9)]
        assert done == planned
        assert store.next_trial("p01") is None


def test_a_spare_person_gets_easy_and_hard_episodes_mixed(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        for code in ("p01", "p02", "p03"):
            store.drop_out(code, "away")
        keys = [key for key in (do_next(store, "p04") for _ in range(12)) if key is not None]
    assert len({key.scene for key in keys}) == 12
    splits = [key.split for key in keys]
    assert len(set(splits[:6])) >= 2
    assert splits != sorted(splits, key=SPLITS.index)
