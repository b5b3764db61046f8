"""Compares our path lengths with those of Recast, the library of Habitat's navmesh, built from a home's drawn mesh.

Dataset -> scenes -> `recast.mjs` -> one JSON document:
`python -m personal_viz.bench.homes.recast_lab DATASET --node-modules FOLDER`.

A laboratory tool: it needs Node.js and `npm install recast-navigation`, which nothing else here uses, so it is no verb
of `personal-viz`, and `make test` never runs it on a dataset.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from sim.episodes.dataset import PersonalDataset
from sim.errors import MissingDependencyError, PersonalVizError
from sim.homes.open_home import home_plan, scene_from_plan
from sim.mesh import Scene, TriangleMesh
from sim.walk.navigation_map import NavigationMap

from .held_out import recorded_walk

STOREY_PAIRS = 60
"""Number of pairs of places on two storeys that are drawn per home."""
_SCRIPT = Path(__file__).with_name("recast.mjs")
_SAME_PLACE = 0.05
"""Paths that Recast finds shorter than this have no ratio (metres)."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Lengths:
    """Path lengths of one home or of many, in metres; inf = not joined."""

    ours: Floats
    """(N,) from the start of each episode to its first view point, end points as asked."""
    recast: Floats
    """(N,) the same by Recast."""
    between_storeys: Floats
    """(M,) by Recast, for pairs of places on two storeys that our map joins."""


class Figures(BaseModel):
    """The agreement of one home or of many with Recast; None = nothing to judge."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    pairs: int
    """Number of episodes."""
    reached: float | None
    """Share of pairs that Recast joins."""
    ratio_median: float | None
    """Median of ours / Recast, over pairs that both join."""
    within_5: float | None
    """Share of these ratios at most 5 % from 1."""
    storey_pairs: int
    """Number of pairs of places on two storeys that our map joins."""
    storey_pairs_joined: float | None
    """Share of these that Recast joins."""


def figures(lengths: Lengths) -> Figures:
    """The table's row for these lengths."""
    judged = np.isfinite(lengths.ours) & np.isfinite(lengths.recast) & (lengths.recast > _SAME_PLACE)
    ratios = lengths.ours[judged] / lengths.recast[judged]
    return Figures(
        pairs=len(lengths.recast),
        reached=_share(np.isfinite(lengths.recast)),
        ratio_median=float(np.median(ratios)) if len(ratios) else None,
        within_5=_share(np.abs(ratios - 1) <= 0.05),
        storey_pairs=len(lengths.between_storeys),
        storey_pairs_joined=_share(np.isfinite(lengths.between_storeys)),
    )


def pooled(homes: Iterable[Lengths]) -> Lengths:
    """The lengths of at least one home together."""
    rows = [(home.ours, home.recast, home.between_storeys) for home in homes]
    ours, recast, between_storeys = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    return Lengths(ours, recast, between_storeys)


def measure(scene: Scene, walks: Floats, *, node_modules: Path) -> Lengths:
    """Measures walks (N, 2, 3) from a start to an end, and seeded pairs of places on two storeys."""
    apart = storey_pairs(scene.navigation)
    found = recast_lengths(scene.mesh, np.concatenate([walks, apart]), node_modules=node_modules)
    return Lengths(_our_lengths(scene.navigation, walks), found[: len(walks)], found[len(walks) :])


def storey_pairs(navigation: NavigationMap) -> Floats:
    """(M, 2, 3) pairs of places on two storeys that the map joins, of STOREY_PAIRS seeded ones; none on one storey."""
    storeys, rng = navigation.storey_heights, np.random.default_rng(0)
    if len(storeys) < 2:
        return np.empty((0, 2, 3))
    chosen = [rng.choice(storeys, 2, replace=False) for _ in range(STOREY_PAIRS)]
    pairs = np.array([[navigation.random_point(rng, storey_y=float(y)) for y in heights] for heights in chosen])
    return pairs[np.isfinite(_our_lengths(navigation, pairs))]


def recast_lengths(mesh: TriangleMesh, pairs: Floats, *, node_modules: Path) -> Floats:
    """(N,) path lengths of pairs (N, 2, 3) by Recast; inf where it joins no places near them.

    Raises:
        MissingDependencyError: Node.js or recast-navigation is missing.
        PersonalVizError: Recast refused the mesh.
    """
    node = require_recast(node_modules)
    with tempfile.TemporaryDirectory() as folder:
        mesh.vertices.astype("<f4").tofile(Path(folder, "vertices.f32"))
        mesh.faces.astype("<i4").tofile(Path(folder, "faces.i32"))
        pairs.astype("<f8").tofile(Path(folder, "pairs.f64"))
        done = subprocess.run([node, _SCRIPT, node_modules, folder], capture_output=True, text=True)
    if done.returncode:
        problem = next((line for line in done.stderr.splitlines() if "Error" in line), f"exit code {done.returncode}")
        raise PersonalVizError(f"{_SCRIPT.name}: {problem}; expected a navmesh. Run it by hand to see more.")
    return np.array([np.inf if length is None else length for length in json.loads(done.stdout)], float)


def require_recast(node_modules: Path) -> str:
    """The path of Node.js, if it and recast-navigation are there; raises MissingDependencyError."""
    node = shutil.which("node")
    if node is None:
        raise MissingDependencyError("PATH: found no program 'node'; expected Node.js 18 or newer. Install it.")
    if not (node_modules / "recast-navigation" / "generators.mjs").is_file():
        raise MissingDependencyError(
            f"--node-modules is {str(node_modules)!r}; expected a folder node_modules with recast-navigation. Make one "
            'with "npm install recast-navigation".'
        )
    return node


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the figures of every scene of DATASET and of all together."""
    parser = argparse.ArgumentParser(description="Compare path lengths in the homes of a dataset with Recast's.")
    parser.add_argument("dataset", type=Path, help="folder of the episodes")
    parser.add_argument("--node-modules", type=Path, required=True, help="folder that holds recast-navigation")
    parser.add_argument("--scene", nargs="+", help="only these scenes")
    given = parser.parse_args(arguments)
    try:
        require_recast(given.node_modules)
        dataset = PersonalDataset(given.dataset)
        names = given.scene or dataset.scenes
        found = {name: _of_scene(dataset, name, node_modules=given.node_modules) for name in names}
    except PersonalVizError as error:
        sys.exit(f"{error}")
    scenes = {name: figures(lengths).model_dump() for name, lengths in found.items()}
    print(json.dumps({"scenes": scenes, "total": figures(pooled(found.values())).model_dump()}, indent=2))


def _of_scene(dataset: PersonalDataset, name: str, *, node_modules: Path) -> Lengths:
    walks = [recorded_walk(episode) for episode in dataset.episodes(scenes=(name,))]
    ends = np.array([(walk.start, walk.end) for walk in walks], float)
    return measure(scene_from_plan(home_plan(dataset, name)), ends, node_modules=node_modules)


def _our_lengths(navigation: NavigationMap, pairs: Floats) -> Floats:
    """(N,) path lengths of pairs (N, 2, 3) by our map."""
    return np.array([navigation.distances(start[None], end[None])[0] for start, end in pairs], float)


def _share(values: NDArray[np.bool_]) -> float | None:
    return float(values.mean()) if len(values) else None


if __name__ == "__main__":
    main()
