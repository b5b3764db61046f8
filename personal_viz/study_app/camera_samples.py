"""Where somebody looks from, sampled while the browser's camera moves; the pose in which it comes to rest is kept."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable

import viser

from human_study.trial.commands import LookFrom
from human_study.trial.session import CAMERA_EVERY_S

SAMPLE_EVERY_S = 1.1 * CAMERA_EVERY_S
"""A little more than the session's limit, so that it keeps every sample."""


class CameraSamples:
    """Listens to one screen's camera."""

    def __init__(self, sample: Callable[[LookFrom], Awaitable[None]]) -> None:
        """Nothing is sampled before the camera moves; `sample` is told each pose that is to be kept."""
        self._sample = sample
        self._looked_from: LookFrom | None = None
        self._is_sampling = False

    async def moved(self, camera: viser.CameraHandle) -> None:
        """Samples the camera while it moves."""
        self._looked_from = LookFrom(three(camera.position), four(camera.wxyz))
        if self._is_sampling:
            return
        self._is_sampling = True
        sent = None
        while self._looked_from != sent:
            sent = self._looked_from
            await self._sample(sent)
            await asyncio.sleep(SAMPLE_EVERY_S)
        self._is_sampling = False


def three(values: Iterable[float]) -> tuple[float, float, float]:
    """Three plain numbers."""
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def four(values: Iterable[float]) -> tuple[float, float, float, float]:
    """Four plain numbers."""
    w, x, y, z = (float(value) for value in values)
    return (w, x, y, z)
