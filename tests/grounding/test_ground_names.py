"""Names that `ground` gives its runs are valid for any options."""

import contextlib
import random
import re
from dataclasses import replace
from pathlib import Path

from grounding.evaluation.settings import GroundSettings
from personal_viz.cli.grounding.ground_names import map_name, run_name
from sim.errors import AgentError
from sim.tasks.run_files import MAX_NAME, RUN_ID

from ..personal_viz.program import personal_viz

LONG = ["--blur", ".5", "--object-noise", ".1", "--cell-noise", ".1", "--clutter-texts"]
NUMBERS = [0.0, 0.1, 0.5, 1e-7, 0.123456789012345, 1e20, 1.0]
ENCODERS = ["hashed", "minilm", "clip:" + "openai/a-long-name-of-a-model" * 3, "siglip:/models/mit Leerzeichen"]


def drawn_settings(draw: random.Random) -> GroundSettings:
    """Settings with random values for everything that a name may show; values that the others exclude are left out."""
    llm = {"phrases": "llm", "llm_url": "http://127.0.0.1:1/v1", "llm_model": draw.choice(["m" * 200, "Größe/x:y"])}
    chosen = [
        {"map": draw.choice(["oracle", "explore", "files"])},
        {"encoder": draw.choice(ENCODERS)},
        {"seed": draw.choice([0, 7, 10**30])},
        {"all_storeys": draw.random() < 0.5},
        draw.choice([{}, {"phrases": "rules"}, llm]),
        {"layout": draw.choice(["grid", "fine"])},
        {"features": draw.choice(["patches", "images"])},
        {"paraphrase": draw.choice([0, 3])},
        {"home_clutter": draw.choice([0, 2])},
        *({name: draw.choice(NUMBERS)} for name in ("blur", "object_noise", "cell_noise", "view_noise", "confusion")),
        *({name: draw.random() < 0.5} for name in ("clutter_texts", "background")),
    ]
    settings = GroundSettings(method=draw.choice(["qs", "rpg", "phrase", "joint"]))
    for change in chosen:
        with contextlib.suppress(AgentError):
            settings = replace(settings, **change)
    return settings


def test_names_of_runs_and_maps_are_valid_for_random_options() -> None:
    draw = random.Random(14)
    num_cut = 0
    for _ in range(1000):
        settings = drawn_settings(draw)
        run, maps = run_name(settings), map_name(settings, "d" * 64, "schematic")
        assert re.fullmatch(RUN_ID, run), run
        assert re.fullmatch(RUN_ID, maps), maps
        num_cut += len(run) == MAX_NAME
    assert num_cut > 50  # some names were long enough to be shortened


def test_a_short_name_is_kept_whole_and_long_ones_stay_different_when_shortened() -> None:
    assert run_name(GroundSettings(method="qs")) == "ground-qs-oracle-hashed-storey-given-seed0"
    noisy = GroundSettings("rpg", blur=0.5, object_noise=0.1, cell_noise=0.1, clutter_texts=True, encoder="minilm")
    names = {run_name(noisy), run_name(replace(noisy, seed=1)), run_name(replace(noisy, all_storeys=True))}
    assert len(names) == 3
    assert {len(name) for name in names} == {MAX_NAME}


def test_a_command_with_long_option_values_writes_its_runs(small_root: Path, tmp_path: Path) -> None:
    same = ["ground", "--dataset", small_root, "--method", "rpg", *LONG, "--out", tmp_path]
    assert personal_viz(*same, "--encoder", "hashed", "--sweep", "blur=0.25,1e20").returncode == 0
    assert (
        personal_viz(*same, "--run-id", "r" * 80, "--sweep", "blur=0.25").returncode == 0
    )  # the name is shortened, not refused
    folders = sorted(path.parent.name for path in tmp_path.glob("*/answers.jsonl"))
    assert len(folders) == 6, "each run has one with phrases by rules beside it"
    assert all(re.fullmatch(RUN_ID, name) for name in folders)
