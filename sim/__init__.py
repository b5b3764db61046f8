"""The world, the tasks, the episodes, and the measures of a run.

The public names are loaded when they are first used: `import sim` itself loads nothing heavy.
"""

from typing import TYPE_CHECKING

from .public_names import loaders_of

if TYPE_CHECKING:
    from .episodes.dataset import PersonalDataset as Dataset
    from .exchange.import_runs import import_runs as import_runs
    from .homes.open_home import open_scene as open_home
    from .mesh import Scene as Home
    from .tasks.agents import Agent as Agent
    from .tasks.gym_env import PanGymEnv as PanGymEnv
    from .tasks.metrics import metrics as metrics
    from .tasks.pan import PanEnv as PanEnv
    from .tasks.runner import play as play
    from .types import Action as Action
    from .types import Camera as Camera

_PLACES = {
    "Action": ("sim.types", "Action"),
    "Agent": ("sim.tasks.agents", "Agent"),
    "Camera": ("sim.types", "Camera"),
    "Dataset": ("sim.episodes.dataset", "PersonalDataset"),
    "Home": ("sim.mesh", "Scene"),
    "PanEnv": ("sim.tasks.pan", "PanEnv"),
    "PanGymEnv": ("sim.tasks.gym_env", "PanGymEnv"),
    "import_runs": ("sim.exchange.import_runs", "import_runs"),
    "metrics": ("sim.tasks.metrics", "metrics"),
    "open_home": ("sim.homes.open_home", "open_scene"),
    "play": ("sim.tasks.runner", "play"),
}
"""Each public name with its module and its name there."""
__all__ = [
    "Action",
    "Agent",
    "Camera",
    "Dataset",
    "Home",
    "PanEnv",
    "PanGymEnv",
    "import_runs",
    "metrics",
    "open_home",
    "play",
]

if not TYPE_CHECKING:  # a type checker that saw them would accept any name
    __getattr__, __dir__ = loaders_of(__name__, _PLACES)
