"""Log the home: the browser copies of the storeys that runs visited, without ceilings."""

from collections.abc import Sequence

import rerun as rr

from sim.scenes.browser_glb import browser_glb
from sim.scenes.scene import Scene

from . import paths

GLB = "model/gltf-binary"


def log_scene(stream: rr.RecordingStream, scene: Scene, *, storeys: Sequence[int]) -> None:
    """Logs the copy of each storey in `storeys` (indices into the scene's storey heights) below `/scene/mesh`.

    Raises:
        SceneError: A storey has no faces.
    """
    for index in storeys:
        glb = browser_glb(scene, scene.navigation.storey_heights[index], srgb_colours=True)
        stream.log(f"{paths.MESH}/{paths.storey_part(index)}", rr.Asset3D(contents=glb, media_type=GLB), static=True)
