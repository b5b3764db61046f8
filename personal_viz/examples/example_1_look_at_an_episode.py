"""Shows an episode's task, its home, the robot's first view, and the shortest path to the target.

    python -m personal_viz.examples.example_1_look_at_an_episode DATASET [SPLIT/SCENE/ID]

Writes first_view.png and from_above.png into the current folder. `DATASET` is data/split, or a folder of `invent`.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from sim import Dataset, PanEnv, open_home, play
from sim.plan_view.axes import draw_free_floor
from sim.tasks.agents import ShortestPathAgent


def look(dataset: Path, episode: str | None = None, *, out: Path = Path()) -> float:
    """Writes both pictures, prints the task, and returns the metres that the shortest-path agent walks."""
    episodes = Dataset(dataset)
    found = episodes.episode(episode) if episode else next(episodes.episodes())
    task = found.task("pan")
    print(f"{found.key}\n{task.description}\nQuery: {task.queries[0]}")

    home = open_home(episodes, found.key.scene)
    first = PanEnv.in_home(home, found).reset()
    assert first.rgb is not None
    Image.fromarray(first.rgb).save(out / "first_view.png")

    run = play(ShortestPathAgent(found, home.navigation), found, home, pictures=False)  # it knows the goal
    way = np.array([run.start.position, *(step.position for step in run.steps)])
    top = home.navigation.top_down(way[0, 1])
    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.subplots()
    axes.set_title(f"{home.label}: {len(run.steps)} actions")
    draw_free_floor(axes, top.free, top.grid)
    axes.plot(way[:, 0], way[:, 2], color="tab:blue")
    for goal in found.targets:
        axes.plot(goal.position[0], goal.position[2], "r*", markersize=14)
    figure.savefig(out / "from_above.png")
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


if __name__ == "__main__":
    print(f"{look(Path(sys.argv[1]), *sys.argv[2:3]):.1f} m")
