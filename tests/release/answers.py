"""The program's answers as JSON values; record.py stores them as literals, the tests compare new ones with those."""

import hashlib
import json
import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene

from .doors import Home, personal_viz, recording_rows

DATA = Path(__file__).parent / "data"
RUNS = DATA / "runs"
STUDY = DATA / "study"
AGENTS = DATA / "study-agents"
RECOVERED = "TEEsavR23oF"
SAMPLE = (RECOVERED, "CrMo8WxCyVb")
"""Homes of the short test of `homes`; all homes would take a quarter of an hour."""
INVENT = ("--homes", "2", "--seed", "11")
INVENTED = ("Invented11", "Invented12")
METHODS = ("qs", "rpg", "phrase", "joint")
NUM_PATHS, NUM_VIEWS = 50, 12
_EDGE = 0.02
"""Pixels whose depth bends by more than this share of itself are left out: half a pixel changes them, not the home."""
_EVERY = 4
"""The literal holds every n-th row and column of the pixels."""
_REPORT_TABLES = {
    "rows": ("task", "scene_kind", "who", "condition", "split", "measure"),
    "spreads": ("task", "scene_kind", "who", "condition", "split", "measure"),
    "ends": ("task", "scene_kind", "who", "condition", "reason"),
    "hypotheses": ("name",),
    "memory": ("task", "scene_kind", "what", "condition", "split", "measure"),
    "order": ("task", "scene_kind", "what", "condition", "split", "measure"),
    "blocks": ("task", "scene_kind", "condition", "by", "block", "measure"),
    "agent_pairs": ("task", "scene_kind", "first", "second"),
    "sensitivity": ("task", "scene_kind", "who", "condition", "way"),
    "agreement": ("task", "scene_kind", "condition"),
    "places": ("task", "scene_kind", "condition"),
    "suspects": ("task", "scene_kind", "condition", "episode"),
    "flow": ("point",),
    "verification": ("task", "scene_kind", "condition"),
    "exclusions": ("rule_id",),
    "left_out": ("who", "task", "reason"),
}
"""Tables of the report, each with the columns that identify a row."""


def literal(name: str) -> Any:
    """The values that `data/<name>.json` holds."""
    return json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))["values"]


def homes_totals(dataset: Path, *scenes: str, plans: Path | None = None) -> dict[str, Any]:
    """`homes --json` without what depends on the machine or the mesh, such as seconds, megabytes and folders."""
    out = () if plans is None else ("--out", plans)
    chosen = ("--scene", *scenes) if scenes else ()
    report = json.loads(personal_viz("homes", "--dataset", dataset, *chosen, *out, "--json"))
    left_out = ("build_s", "triangles", "glb_mb", "why_not_findable", "sources")
    total, *scenes_kept = (
        {key: value for key, value in figures.items() if key not in left_out}
        for figures in (report["total"], *report["scenes"].values())
    )
    return {"total": total, "scenes": dict(zip(report["scenes"], scenes_kept, strict=True))}


def ground_answers(dataset: Path, out: Path, method: str) -> dict[str, Any]:
    """Figures of `ground` on oracle maps; scores and a digest of the answers in each home."""
    run_id = f"frozen-{method}"
    said = personal_viz(
        "ground", "--dataset", dataset, "--method", method, "--encoder", "hashed", "--out", out,
        "--run-id", run_id, "--json",
    )  # fmt: skip
    return answers_in(json.loads(said), out / run_id)


def answers_in(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Figures that `ground` printed; all scores of each home's answers in the run folder, and a digest of the rest.

    Processors differ in the last digit of some scores, so scores are in no digest; the order of candidates is.
    """
    figures = {key: document[key] for key in ("n", "n_per_split", "sr", "top3", "pooled", "storey_given")}
    fields = ("split", "scene", "episode_id", "candidates", "storey_given", "reason", "fell_back")
    measures = ("success", "top3_success", "planar_distance", "distance_3d", "planar_distances")
    homes: dict[str, list[str]] = {}
    scores: dict[str, list[float]] = {}
    for line in map(json.loads, (folder / "answers.jsonl").read_text(encoding="utf-8").splitlines()):
        kept = [line[field] for field in fields] + [line["measures"][field] for field in measures]
        homes.setdefault(line["scene"], []).append(json.dumps(kept))
        scores.setdefault(line["scene"], []).extend(line["scores"])
    return {
        "figures": figures,
        "digests": {scene: _digest(homes[scene]) for scene in sorted(homes)},
        "scores": {scene: scores[scene] for scene in sorted(scores)},
    }


def habitat_agreement(golden: Path) -> dict[str, Any]:
    """`check-habitat --json` without the files' hashes and the versions of programs."""
    found = json.loads(personal_viz("check-habitat", "--golden", golden, "--json"))
    left_out = ("files", "made_with", "compared_with")
    return {key: value for key, value in found.items() if key not in left_out}


def invented(out: Path) -> Path:
    """The dataset of two invented homes."""
    personal_viz("invent", *INVENT, "--out", out)
    return out


def home_poses(home: Home, plan: Path) -> dict[str, Any]:
    """Centre and size of each object of the opened home, and the yaw that its plan file gives it, by name."""
    yaws = {thing["name"]: thing.get("yaw", 0.0) for thing in json.loads(plan.read_text())["furniture"]}
    return {
        name: {"centre": _mm(centre), "size": _mm(size), "yaw": _rounded(yaws[name]) if name in yaws else None}
        for name, (centre, size) in sorted(home.objects.items())
    }


def home_areas(home: Home) -> dict[str, Any]:
    """Heights (metres) and walkable areas (square metres) of the storeys."""
    return {
        "heights": _mm(home.storey_heights),
        "square_metres": [_rounded(home.area(storey_y)) for storey_y in home.storey_heights],
    }


def chosen_paths(home: Home) -> list[list[list[float]]]:
    """Start and goal, world metres, of each path in a literal; a path joins them."""
    rng = np.random.default_rng(1)
    pairs = [[home.place(rng), home.place(rng)] for _ in range(4 * NUM_PATHS)]
    return [pair for pair in pairs if np.isfinite(home.distance(*pair))][:NUM_PATHS]


def path_lengths(home: Home, paths: Iterable[list[list[float]]]) -> list[float]:
    """Geodesic length of each path in metres."""
    return [_rounded(home.distance(start, goal)) for start, goal in paths]


def chosen_views(home: Home) -> list[list[Any]]:
    """(position of the feet, yaw in radians) of each depth picture."""
    rng = np.random.default_rng(2)
    return [[home.place(rng), _rounded(rng.uniform(-np.pi, np.pi))] for _ in range(NUM_VIEWS)]


def depth_mm(home: Home, views: list[list[Any]], *, all_pixels: bool = False) -> list[list[float | None]]:
    """Every fourth pixel of each picture, millimetres, row by row; None beside an edge unless `all_pixels`."""
    edge = np.inf if all_pixels else _EDGE
    return [_away_from_edges(depth_m, edge) for depth_m in home.depths([(place, yaw) for place, yaw in views])]


def metrics_of_runs() -> dict[str, Any]:
    """`metrics --json` of the stored runs under each rule, by row."""
    runs = sorted(path.parent for path in RUNS.glob("*/run.json"))
    found = {}
    for rule in ("paper", "habitat", "authors"):
        rows = json.loads(personal_viz("metrics", *runs, "--rule", rule, "--json"))
        found[rule] = _by_name(rows, ("task", "who", "who_kind", "condition", "scene_kind", "split"))
    return found


def report_numbers(out: Path) -> dict[str, Any]:
    """The numbers of `study report --json` on the stored study, by table and row."""
    agents = sorted(path.parent for path in AGENTS.glob("*/run.json"))
    report = json.loads(personal_viz("study", "report", STUDY, *agents, "--out", out, "--json"))
    tables = {name: _by_name(report[name], keys) for name, keys in _REPORT_TABLES.items()}
    successes = {"/".join(row[key] for key in ("task", "who", "condition", "participant", "episode")): row["success"]
                 for row in report["outcomes"]}  # fmt: skip
    return {name: rows for name, rows in tables.items() if rows} | {"outcomes": successes}


def replayed_rows(dataset: Path, out: Path) -> dict[str, dict[str, int]]:
    """Rows of each component by entity, in the recording of the stored runs of one episode.

    The runs are copied and name the home as it is opened here: processors differ in the last bits of its arrays.
    """
    home = open_scene(PersonalDataset(dataset), RECOVERED)
    copies = Path(shutil.copytree(RUNS, out.with_name("runs")))
    for steps in copies.glob("*/steps.jsonl"):
        steps.write_text(re.sub(r'("scene_digest":)"[0-9a-f]{64}"', rf'\1"{home.digest}"', steps.read_text()))
    runs = sorted(path.parent for path in copies.glob("*/run.json"))
    episode = f"easy/{RECOVERED}/240"
    personal_viz("replay", "--dataset", dataset, "--runs", *runs, "--episode", episode, "--out", out)
    return recording_rows(out)


def _by_name(rows: list[dict[str, Any]], keys: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """The numbers of each row, by the row's name."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        name = " | ".join(str(row[key]) for key in keys if key in row)
        assert name not in found, f"two rows are named {name!r}"
        found[name] = _numbers({key: value for key, value in row.items() if key not in keys})
    return found


def _numbers(row: dict[str, Any]) -> dict[str, Any]:
    """The row without its text fields."""
    kept = {key: _numbers(value) if isinstance(value, dict) else value for key, value in row.items()}
    return {key: value for key, value in kept.items() if value is None or isinstance(value, bool | int | float | dict)}


def _away_from_edges(depth_m: np.ndarray, edge: float) -> list[float | None]:
    """Every fourth pixel, millimetres. On any plane, the inverse of the depth is linear in the picture."""
    near = 1 / np.maximum(depth_m, 1e-3)
    bend = np.zeros_like(near)
    bend[:, 1:-1] = np.abs(near[:, 2:] + near[:, :-2] - 2 * near[:, 1:-1])
    bend[1:-1] = np.maximum(bend[1:-1], np.abs(near[2:] + near[:-2] - 2 * near[1:-1]))
    at = slice(2, None, _EVERY)
    kept = zip(depth_m[at, at].ravel(), (bend * depth_m)[at, at].ravel(), strict=True)
    return [None if bends > edge else round(1000 * float(depth), 1) for depth, bends in kept]


def _digest(lines: list[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:32]


def _mm(values: Iterable[float]) -> list[float]:
    return [round(float(value), 4) for value in values]


def _rounded(value: float) -> float:
    return round(float(value), 6)
