"""Log which home and episode a recording shows, and the browser copies of its storeys, without ceilings."""

from collections.abc import Sequence

import rerun as rr

from sim.episodes.schema import Episode
from sim.scenes.browser_glb import browser_glb
from sim.scenes.scene import Scene

from . import paths

GLB = "model/gltf-binary"


def log_identity(stream: rr.RecordingStream, episode: Episode, scene: Scene) -> None:
    """Names the recording and says of which episode and home it is, and which way is up."""
    stream.send_recording_name(f"{episode.key} in {scene.label}")
    facts = rr.AnyValues(episode=str(episode.key), scene=scene.name, scene_kind=scene.kind, scene_digest=scene.digest)
    stream.send_property("episode", facts)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)


def log_scene(stream: rr.RecordingStream, scene: Scene, *, storeys: Sequence[int]) -> None:
    """Logs the copy of each storey in `storeys` (indices into the scene's storey heights) below `/scene/mesh`.

    Raises:
        SceneError: A storey has no faces.
    """
    for index in storeys:
        glb = browser_glb(scene, scene.navigation.storey_heights[index], srgb_colours=True)
        stream.log(f"{paths.MESH}/{paths.storey_part(index)}", rr.Asset3D(contents=glb, media_type=GLB), static=True)
