"""The pictures of one home for its PAN participants: rendered once per pose, kept for a while, and rendered ahead.

Wraps the home's renderer. A picture that somebody waits for goes first; while nobody waits, one thread renders pictures
that the next key could show. A picture leaves this module only when it is asked for, so browsers never get one before
its key.
"""

import logging
import os
import sys
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.frames import T_world_camera
from sim.render.renderer import Hits, Renderer, jpeg_bytes
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Frame, Pose
from sim.walk.navigation_map import NavigationMap

_logger = logging.getLogger("personal_viz.study_app.home.frames")
KEPT_FRAMES = 128
"""Kept pictures of a home, 0.9 MB each at 640 x 480: enough for the next pictures of two dozen participants."""
_STARVED = 1.6
"""The machine counts as busy when a picture's elapsed time is this many times its CPU time."""
_REST_S = 0.25
"""Seconds for which nothing is rendered ahead after the machine was busy."""
RENDER_NICE = 10
"""Nice value of the render threads: a key that waits to be stored goes before every picture."""
_Key = tuple[bytes, Camera]
_Job = Callable[[], None]


class RenderThreads:
    """Threads of a process that render for all of its homes: first awaited pictures, then pictures ahead."""

    def __init__(self, count: int | None = None) -> None:
        """Takes the number of threads; starts none before there is something to do.

        Args:
            count: Number of threads; None = one per core. More would only make everybody's picture late.
        """
        self._count = count if count is not None else len(os.sched_getaffinity(0))
        assert self._count > 0, self._count
        self._lock = threading.Condition()
        self._wanted: deque[_Job] = deque()
        self._wishes: OrderedDict[Hashable, deque[_Job]] = OrderedDict()
        self._is_looking_ahead = False
        self._rest_until_s = 0.0
        self._num_started = 0

    def run(self, job: _Job) -> None:
        """Does a job as soon as a thread is free, in the order of calls; returns at once."""
        with self._lock:
            self._wanted.append(job)
            self._wake()

    def look_ahead(self, who: Hashable, jobs: Sequence[_Job]) -> None:
        """Does jobs while nobody waits, in their order; earlier wishes for `who` are forgotten."""
        with self._lock:
            self._wishes[who] = deque(jobs)
            self._wishes.move_to_end(who, last=False)
            self._wake()

    def _wake(self) -> None:
        """Wakes or starts a thread; called with the lock held."""
        if self._num_started < self._count:
            self._num_started += 1
            threading.Thread(target=self._work, daemon=True, name="render").start()
        self._lock.notify()

    def _work(self) -> None:
        if sys.platform == "linux":  # elsewhere priorities belong to whole processes
            own = threading.get_native_id()
            os.setpriority(os.PRIO_PROCESS, own, max(RENDER_NICE, os.getpriority(os.PRIO_PROCESS, own)))
        while True:
            with self._lock:
                while (job := self._next_job()) is None:
                    rest_s = self._rest_until_s - time.monotonic()
                    self._lock.wait(rest_s if rest_s > 0 and self._wishes else None)
            try:
                job()
            except Exception:  # the thread draws for everybody in the process
                _logger.exception("a picture could not be drawn")

    def _next_job(self) -> _Job | None:
        """The next job; None = wait. One thread at a time looks ahead. Needs the lock."""
        if self._wanted:
            return self._wanted.popleft()
        if self._is_looking_ahead or time.monotonic() < self._rest_until_s:
            return None
        while self._wishes:
            who, jobs = self._wishes.popitem(last=False)
            if jobs:
                job = jobs.popleft()
                self._wishes[who] = jobs
                self._is_looking_ahead = True
                return lambda: self._ahead(job)
        return None

    def _ahead(self, job: _Job) -> None:
        """Does a wish; if other work wanted the core meanwhile, no wish is done for a while."""
        elapsed, cpu = time.perf_counter(), time.thread_time()
        try:
            job()
        finally:
            elapsed, cpu = time.perf_counter() - elapsed, time.thread_time() - cpu
            with self._lock:
                self._is_looking_ahead = False
                if elapsed > _STARVED * cpu + 0.002:
                    self._rest_until_s = time.monotonic() + _REST_S


class Frames:
    """A `Renderer` that remembers, renders ahead and encodes; its pictures have the wrapped renderer's bytes.

    All methods may be called from several threads at once, but not from a job of its `RenderThreads`.
    """

    def __init__(
        self, renderer: Renderer, threads: RenderThreads, *, kept: int = KEPT_FRAMES, keep_depth: bool = False
    ) -> None:
        """Renders nothing yet.

        Args:
            renderer: Draws the home; one thread per picture gives several people most pictures a second.
            threads: The threads that call it.
            kept: Number of remembered pictures; the ones unused for longest go first.
            keep_depth: Whether frames have their depth and object ids, for researchers who watch; otherwise these are
                zero, since participants see neither, and a remembered frame takes a quarter of the memory.
        """
        self._renderer, self._threads, self._kept, self._keep_depth = renderer, threads, kept, keep_depth
        self._lock = threading.Lock()
        self._frames: OrderedDict[_Key, Future[Frame]] = OrderedDict()
        self._jpegs: dict[int, bytes] = {}

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """The wrapped renderer's frame, perhaps from memory. Raises the wrapped renderer's errors."""
        return self._begun((np.asarray(T_world_camera, np.float64).tobytes(), camera)).result()

    def begin(self, pose: Pose, camera: Camera) -> None:
        """Begins to render a picture that will be asked for soon; returns at once."""
        self._begun((T_world_camera(pose, camera).tobytes(), camera))

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        """The frames of poses (B, 4, 4), each from `render`."""
        return [self.render(T, camera) for T in Ts_world_camera]

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        """The wrapped renderer's depth, never from memory."""
        return self._renderer.depth(T_world_camera, camera)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """The wrapped renderer's hits."""
        return self._renderer.cast(origins, directions)

    def jpeg(self, rgb: NDArray[np.uint8]) -> bytes:
        """A picture (H, W, 3) as JPEG; encoded once while it is remembered."""
        known = self._jpegs.get(id(rgb))
        return known if known is not None else jpeg_bytes(rgb)

    def look_ahead(self, who: Hashable, poses: Sequence[Pose], camera: Camera) -> None:
        """Renders pictures while nobody waits, in their order; returns at once.

        Args:
            who: The participant; earlier wishes for the participant are forgotten.
            poses: Poses that the robot may have next (`successors`).
            camera: The robot's camera.
        """
        keys = [(T_world_camera(pose, camera).tobytes(), camera) for pose in poses]
        self._threads.look_ahead(who, [lambda key=key: self._fill_ahead(key) for key in keys])

    def _begun(self, key: _Key) -> Future[Frame]:
        """The place of a frame that is rendered, or being rendered."""
        place, is_new = self._place_of(key)
        if is_new:
            self._threads.run(lambda: self._fill(key, place))
        return place

    def _place_of(self, key: _Key) -> tuple[Future[Frame], bool]:
        """The place of a frame, and whether it is new, so that the caller has to fill it."""
        with self._lock:
            place = self._frames.get(key)
            if place is not None:
                self._frames.move_to_end(key)
                return place, False
            place = self._frames[key] = Future()
            self._forget_old()
            return place, True

    def _fill_ahead(self, key: _Key) -> None:
        place, is_new = self._place_of(key)
        if is_new:
            self._fill(key, place)

    def _fill(self, key: _Key, place: "Future[Frame]") -> None:
        """Renders a frame into its place; a failure is raised for all who wait for the frame, and then forgotten."""
        matrix, camera = key
        try:
            frame = self._renderer.render(np.frombuffer(matrix).reshape(4, 4), camera)
            jpeg = jpeg_bytes(frame.rgb)
        except Exception as error:  # a render thread's door: the waiting thread must hear of it
            with self._lock:
                self._frames.pop(key, None)
            place.set_exception(error)
            return
        with self._lock:
            self._jpegs[id(frame.rgb)] = jpeg
        place.set_result(frame if self._keep_depth else _without_depth(frame))

    def _forget_old(self) -> None:
        """Forgets frames over the limit, called with the lock held; frames that are being rendered stay."""
        num_over = len(self._frames) - self._kept
        done = [key for key, place in self._frames.items() if place.done()] if num_over > 0 else []
        for key in done[:num_over]:
            self._jpegs.pop(id(self._frames.pop(key).result().rgb), None)


def successors(
    pose: Pose, navigation: NavigationMap, actions: Sequence[Action], *, last: Action | None = None
) -> list[Pose]:
    """The robot's poses after each action that moves it, the likeliest first: the last action is often repeated.

    Args:
        pose: The robot's present pose.
        navigation: The floor where it can walk.
        actions: Actions that the participant may use.
        last: The last action, if any.
    """
    moves = [action for action in actions if action not in (Action.STOP, Action.FOUND)]
    moves.sort(key=lambda action: action is not last)
    poses = []
    for action in moves:
        env = PanEnv(pose, navigation, renderer=None)
        env.move(action)
        poses.append(env.pose)
    return poses


def _without_depth(frame: Frame) -> Frame:
    shape = frame.depth_m.shape
    depth_m, ids = np.broadcast_to(np.float32(0), shape), np.broadcast_to(np.int32(0), shape)
    return replace(frame, depth_m=depth_m, ids=ids)
