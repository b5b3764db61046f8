"""One walks where one sees, in 40 invented homes and in all recovered ones: figures of `personal-viz homes`."""

import json
from typing import Any

import pytest

from .doors import personal_viz

pytestmark = pytest.mark.timeout(2400)
NUM_SEEDS = 40


@pytest.fixture(scope="module", params=["invented", "recovered"])
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Figures of each home and of all together."""
    if request.param == "invented":
        dataset = tmp_path_factory.mktemp("invented")
        personal_viz("invent", "--homes", str(NUM_SEEDS), "--out", dataset)
    else:
        dataset = request.getfixturevalue("dataset_root")
    found = json.loads(personal_viz("homes", "--dataset", dataset, "--no-folds", "--jobs", "2", "--json"))
    assert len(found["scenes"]) == (NUM_SEEDS if request.param == "invented" else 31)
    return found


def test_the_picture_shows_what_is_in_the_way(report: dict[str, Any]) -> None:
    assert report["total"]["phantom"] <= 0.05
    assert report["total"]["phantom_free_ahead"] <= 0.12
    assert {name: home["phantom"] for name, home in report["scenes"].items() if home["phantom"] > 0.08} == {}


def test_the_floor_that_is_drawn_is_walked_on_and_joins_the_storeys(report: dict[str, Any]) -> None:
    most = 1.045 if len(report["scenes"]) == NUM_SEEDS else 1.04
    assert 0.97 <= report["total"]["mesh_over_map"] <= most
    assert report["total"]["storey_pairs_joined"] >= 0.95
    assert report["total"]["playable"] >= 0.995
    assert {name for name, home in report["scenes"].items() if home["lifts"] or home["playable"] < 0.96} == set()


def test_things_stand_or_hang_and_nobody_stands_on_beds_or_in_walls(report: dict[str, Any]) -> None:
    total = report["total"]
    assert total["floating"] <= 0.01
    assert total["in_walls"] <= 0.002
    assert total["on_beds"] == 0
    assert total["clearance_starts"] <= 0.002
    assert total["clearance_views"] <= 0.01
    assert {name for name, home in report["scenes"].items() if home["floating"] > 0.01} == set()
