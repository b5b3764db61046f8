"""Log which home and episode a recording shows, and the browser copies of its storeys, without ceilings."""

import re
import struct
from collections.abc import Sequence

import rerun as rr

from sim.copies.browser_glb import browser_glb
from sim.episodes.schema import Episode
from sim.mesh import Scene

from . import paths

GLB = "model/gltf-binary"
_FILTER = re.compile(rb'"(?:mag|min)Filter":\d+,')
_JSON_AT = 20
"""Where the text begins in binary glTF; its length stands 8 bytes before."""


def log_identity(stream: rr.RecordingStream, episode: Episode, scene: Scene) -> None:
    """Names the recording and says of which episode and home it is, and which way is up."""
    stream.send_recording_name(f"{episode.key} in {scene.label}")
    facts = rr.AnyValues(episode=str(episode.key), scene=scene.name, scene_kind=scene.kind, scene_digest=scene.digest)
    stream.send_property("episode", facts)
    log_up(stream)


def log_up(stream: rr.RecordingStream) -> None:
    """Says which way is up."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)


def log_scene(stream: rr.RecordingStream, scene: Scene, *, storeys: Sequence[int]) -> None:
    """Logs the copy of each storey in `storeys` (indices into the scene's storey heights) below `/scene/mesh`.

    Raises:
        SceneError: A storey has no faces.
    """
    for index in storeys:
        glb = browser_glb(scene, scene.navigation.storey_heights[index], srgb_colours=True)
        stream.log(
            f"{paths.MESH}/{paths.storey_part(index)}",
            rr.Asset3D(contents=_without_filters(glb), media_type=GLB),
            static=True,
        )


def _without_filters(glb: bytes) -> bytes:
    """A browser copy whose textures ask for no filters: Rerun has only one, and warns of each that wants another."""
    (length,) = struct.unpack_from("<I", glb, _JSON_AT - 8)
    text = glb[_JSON_AT : _JSON_AT + length]
    return glb[:_JSON_AT] + _FILTER.sub(lambda found: b" " * len(found[0]), text) + glb[_JSON_AT + length :]
