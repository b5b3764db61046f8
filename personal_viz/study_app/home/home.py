"""One home as participants meet it: scene, renderer, browser copies, episodes. Shared by all who are in it."""

from dataclasses import dataclass

from human_study.design.study import StudyConfig
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.tasks.pan import PanEnv
from sim.tasks.pog import PogScene
from sim.types import EpisodeKey

from ..watch import Watches
from .frames import Frames
from .scene_view import StoreyCopies


@dataclass(frozen=True, slots=True)
class Home:
    """What all who are in a home share."""

    scene: Scene
    renderer: Frames
    pog_scene: PogScene
    copies: StoreyCopies
    episodes: dict[EpisodeKey, Episode]
    storeys: list[tuple[float, float]]
    """(lowest, highest) floor of each storey, from the episodes."""
    watches: Watches
    """What a researcher sees meanwhile."""

    def close(self) -> None:
        """Nobody is in the home any more."""
        self.watches.close()


def pan_env(episode: Episode, scene: Scene, renderer: Renderer, config: StudyConfig) -> PanEnv:
    """What a PAN participant walks in."""
    camera, steps = config.robot_camera, config.steps
    return PanEnv(episode.start, scene.navigation, renderer=renderer, camera=camera, max_steps=steps)
