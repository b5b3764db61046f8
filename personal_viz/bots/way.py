"""Where `shortest` PAN bots get their actions: from the study's records, its dataset and the shortest-path agent."""

import threading
from collections.abc import Sequence

from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.types import Action, EpisodeKey

from .homes import BotHomes


class WayFinder:
    """The way to the target of each participant's present trial: ground truth, for bots on our own machine only."""

    def __init__(self, homes: BotHomes) -> None:
        """Opens no home yet."""
        self._homes = homes
        self._ways: dict[EpisodeKey, tuple[Action, ...]] = {}
        self._lock = threading.Lock()

    def way(self, code: str) -> Sequence[Action]:
        """All actions of the participant's present trial; () when there is none."""
        key = self._homes.due(code)
        if key is None:
            return ()
        with self._lock:
            if key not in self._ways:
                self._ways[key] = self._walk(key)
            return self._ways[key]

    def _walk(self, key: EpisodeKey) -> tuple[Action, ...]:
        config, episode, scene = self._homes.config, self._homes.episode(key), self._homes.scene(key.scene)
        env = PanEnv(episode.start, scene.navigation, renderer=None, max_steps=config.steps)
        agent = ShortestPathAgent(episode, scene.navigation)
        agent.reset(config.task_for(episode, "pan"), env.camera, seed=0)
        observation, actions = env.reset(), []
        while not env.is_over:
            actions.append(agent.act(observation))
            observation = env.step(actions[-1])
        return tuple(actions)
