"""People and your agent on one timeline in Rerun: their paths, what each saw, and when each stopped.

    python -m personal_viz.examples.example_5_agent_beside_people DATASET pair.rrd PEOPLE_RUN...

`PEOPLE_RUN` are run folders of `personal-viz study export`. The agent now plays the episode that they share.
Open the file with: rerun pair.rrd
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from personal_viz.examples.example_2_your_own_agent import ExplainingAgent
from recordings import log_comparison
from recordings.traces import common_episode
from sim import Dataset, open_home, play
from sim.homes.renderers import renderer_of
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import Run, read_run


def beside(dataset: Path, people: Sequence[Path], out: Path) -> Path:
    """Plays the episode that the people share with the agent and writes all of them into one recording."""
    episodes = Dataset(dataset)
    runs = [read_run(folder) for folder in people]
    episode = episodes.episode(common_episode(runs))
    home = open_home(episodes, episode.key.scene)

    played = play(ExplainingAgent(), episode, home, seed=0)
    info = make_run_info(
        "explainer",
        who="explainer",
        who_kind="agent",
        scene_kind=home.kind,
        dataset_digest=episodes.digest(),
        seed=0,
    )
    agent = Run(info=info, episodes=(played,))
    return log_comparison(
        [*runs, agent], episode=episode, scene=home, out=out, renderer=renderer_of(home), with_pixels=False
    )


if __name__ == "__main__":
    print(f"rerun {beside(Path(sys.argv[1]), [Path(name) for name in sys.argv[3:]], Path(sys.argv[2]))}")
