"""Homes are as at commit 0d21b8b: objects, depth within 1 mm, areas, path lengths within 0.1 %, figures equal."""

from pathlib import Path
from typing import Any

import pytest

from .answers import (
    INVENTED,
    RECOVERED,
    SAMPLE,
    depth_mm,
    home_areas,
    home_poses,
    homes_totals,
    invented,
    literal,
    path_lengths,
)
from .differences import differences
from .doors import Home, open_home

MM = 0.001
PER_MILLE = 0.001
LAST_DIGIT = 0.00011
"""Shares are printed with four digits; the order of a sum may change the last digit by one."""


@pytest.fixture(scope="module")
def measured(dataset_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """Figures of the sample of homes, and the folder of their plans."""
    plans = tmp_path_factory.mktemp("plans")
    return homes_totals(dataset_root, *SAMPLE, plans=plans), plans


@pytest.fixture(scope="module")
def invented_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Dataset of two homes that are invented again from their seeds."""
    return invented(tmp_path_factory.mktemp("invented"))


def test_homes_prints_the_same_figures_for_a_sample(measured: tuple[Any, Path]) -> None:
    """Two homes and their total; the next test covers all homes and takes a quarter of an hour."""
    found, _ = measured
    assert differences(literal("homes-sample"), found, absolute=LAST_DIGIT) == []
    every = {"scenes": {name: literal("homes")["scenes"][name] for name in SAMPLE}}
    assert differences(every, found, absolute=LAST_DIGIT) == []


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_homes_prints_the_same_figures_for_all_homes(dataset_root: Path) -> None:
    """Takes a quarter of an hour, so it runs only when asked for: pytest -m bench tests/release."""
    assert differences(literal("homes"), homes_totals(dataset_root), absolute=LAST_DIGIT) == []


def test_the_recovered_home_is_the_same(dataset_root: Path, measured: tuple[Any, Path]) -> None:
    frozen = literal("recovered-home")[RECOVERED]
    plan = measured[1] / f"{RECOVERED}.plan.json"
    assert problems(frozen, open_home(dataset_root, RECOVERED), plan) == []


@pytest.mark.parametrize("name", INVENTED)
def test_an_invented_home_is_the_same(name: str, invented_dataset: Path) -> None:
    plan = invented_dataset / "scenes" / f"{name}.plan.json"
    assert problems(literal("invented-homes")[name], open_home(invented_dataset, name), plan) == []


def problems(frozen: dict[str, Any], home: Home, plan: Path) -> list[str]:
    """Differences of the home from the literal; an added object is one too."""
    found = home_poses(home, plan)
    new = [f"/objects/{name}: is new" for name in found.keys() - frozen["objects"].keys()]
    areas, paths, depth = home_areas(home), frozen["paths"], frozen["depth"]
    return [
        *sorted(new),
        *differences(frozen["objects"], found, absolute=MM, where="/objects"),
        *differences(frozen["areas"]["heights"], areas["heights"], absolute=MM, where="/heights"),
        *differences(frozen["areas"]["square_metres"], areas["square_metres"], rel=PER_MILLE, where="/areas"),
        *differences(paths["lengths"], path_lengths(home, paths["ends"]), rel=PER_MILLE, where="/paths"),
        *far_depths(depth["mm"], depth_mm(home, depth["views"], all_pixels=True)),
    ]


def far_depths(frozen: list[list[float | None]], found: list[list[float | None]]) -> list[str]:
    """Pixels whose depth differs by more than 1 mm, where the literal has one (not beside edges)."""
    return [
        f"/depth[{view}][{pixel}]: {now} mm; expected {then}"
        for view, (before, after) in enumerate(zip(frozen, found, strict=True))
        for pixel, (then, now) in enumerate(zip(before, after, strict=True))
        if then is not None and (now is None or abs(then - now) > 1.0)
    ]
