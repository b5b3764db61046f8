"""The renderer of a scene; where the scene has labels, it writes category names on the objects."""

from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim.render.renderer import Hits, Renderer
from sim.types import Camera, Frame

from ..mesh import Scene

if TYPE_CHECKING:
    from sim.render.raycast import Raycaster

MIN_SHARE = 5e-4
"""Least share of the picture that a named object fills (150 pixels of 640 x 480)."""
_FONT_SHARE = 1 / 34
"""Height of the letters as a share of the picture's height."""
_RENDERERS: "WeakKeyDictionary[Scene, RecallingRenderer]" = WeakKeyDictionary()
"""Renderers of the scenes that are in use."""
_SAME_PLACE = 1e-6
"""Poses that differ by less show the same: they come from one pose by different arithmetic."""


class RecallingRenderer:
    """A renderer that keeps its last frame, because perception asks what is in the picture that the robot just got."""

    def __init__(self, renderer: Renderer) -> None:
        """Wraps `renderer`."""
        self.wrapped = renderer
        self._last: Frame | None = None

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """The wrapped renderer's frame."""
        frame = self._last = self.wrapped.render(T_world_camera, camera)
        return frame  # not `_last`, which another thread may have replaced

    def render_again(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """The last frame if it was taken from here, otherwise a new one."""
        last = self._last
        if last is None or last.camera != camera:
            return self.render(T_world_camera, camera)
        is_here = np.allclose(last.T_world_camera, T_world_camera, rtol=0, atol=_SAME_PLACE)
        return last if is_here else self.render(T_world_camera, camera)

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        """The wrapped renderer's frames of poses (B, 4, 4)."""
        return self.wrapped.render_batch(Ts_world_camera, camera)

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        """The wrapped renderer's depth."""
        return self.wrapped.depth(T_world_camera, camera)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """The wrapped renderer's hits."""
        return self.wrapped.cast(origins, directions)


class LabelledRenderer:
    """A renderer whose pictures name each object in view, in the middle of its visible pixels."""

    def __init__(self, renderer: Renderer, scene: Scene) -> None:
        """Wraps `renderer`; depth, ids and rays stay its own."""
        self._renderer = renderer
        self._words = {item.instance_id: item.category for item in scene.objects}

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """The wrapped renderer's frame, with words in `rgb`; the same pose gives the same bytes."""
        return self._with_words(self._renderer.render(T_world_camera, camera))

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        """The wrapped renderer's frames of poses (B, 4, 4), with words in `rgb`."""
        return [self._with_words(frame) for frame in self._renderer.render_batch(Ts_world_camera, camera)]

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        """The wrapped renderer's depth."""
        return self._renderer.depth(T_world_camera, camera)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """The wrapped renderer's hits."""
        return self._renderer.cast(origins, directions)

    def _with_words(self, frame: Frame) -> Frame:
        return replace(frame, rgb=self._named(frame))

    def _named(self, frame: Frame) -> NDArray[np.uint8]:
        height, width = frame.instance_ids.shape
        counts = np.bincount(frame.instance_ids.ravel())
        picture = Image.fromarray(frame.rgb)
        draw = ImageDraw.Draw(picture)
        font = ImageFont.load_default(size=max(8.0, height * _FONT_SHARE))
        for instance in np.flatnonzero(counts >= MIN_SHARE * height * width).tolist():
            word = self._words.get(instance)
            if word is None:
                continue
            rows, cols = np.nonzero(frame.instance_ids == instance)
            at = (float(np.median(cols)), float(np.median(rows)))
            left, top, right, bottom = draw.textbbox(at, word, font=font, anchor="mm")
            draw.rectangle((left - 3, top - 2, right + 3, bottom + 2), fill=(255, 255, 255))
            draw.text(at, word, font=font, anchor="mm", fill=(20, 20, 20))
        return np.asarray(picture)


def raycaster_of(scene: Scene, *, threads: int | None = None) -> "Raycaster":
    """The plain renderer of a scene: texels as Habitat reads them for scans, mip levels where textures repeat.

    `threads` are those of `Raycaster`; they change no pixel.
    """
    from sim.render.raycast import Raycaster

    texture_filter = "bilinear" if scene.kind == "scan" else "mipmap"
    return Raycaster(scene.mesh, texture_filter=texture_filter, threads=threads)


def renderer_of(scene: Scene, *, threads: int | None = None) -> RecallingRenderer:
    """The renderer of the pictures for people and agents; `Scene.labels` says whether it names the objects.

    Without `threads` (see `Raycaster`; they change no pixel), all calls for a scene give the same renderer.
    """
    if threads is None and scene in _RENDERERS:
        return _RENDERERS[scene]
    plain = raycaster_of(scene, threads=threads)
    renderer = RecallingRenderer(LabelledRenderer(plain, scene) if scene.labels else plain)
    if threads is None:
        _RENDERERS[scene] = renderer
    return renderer
