"""PAN: walk to the object. `PanEnv` owns the pose, takes actions, gives observations; it knows nothing of the goal.

In a home sequence one search follows the other from where the robot stands, each with steps of its own.
"""

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.errors import SceneError, TaskStateError
from sim.frames import T_start_camera, T_world_camera, forward_from_yaw, gps_from_poses, wrap_angle
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.types import FORWARD_STEP, MAX_STEPS, TURN_STEP, Action, Camera, EndReason, Observation, Pose, Prompt
from sim.walk.navigation_map import NavigationMap

from .run_files import Step

SIMULATOR_VERSION = 1
"""Raise it with every change of steps or measures; trials verified under another number are verified again."""


class PanEnv:
    """One PAN episode, or one home sequence, on one scene: reset, then step until it is over."""

    def __init__(
        self,
        episode_start: Pose,
        navigation: NavigationMap,
        *,
        renderer: Renderer | None,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
        colours: bool = True,
        max_steps: int = MAX_STEPS,
        allow_sliding: bool = False,
        prompts: Sequence[Prompt] = (),
    ) -> None:
        """Places the robot at the start exactly as recorded, without snapping (habitat-lab's rule).

        Args:
            episode_start: Start pose, world frame.
            navigation: The floor on which the robot can walk.
            renderer: Draws the camera's view; None leaves `rgb` and `depth_m` of observations None.
            camera: Intrinsics and mounting height.
            colours: False leaves `rgb` None and draws depth alone, which is faster.
            max_steps: The episode, or one search of a sequence, is over after this many actions; STOP or FOUND as the
                last one counts.
            allow_sliding: Slide along walls; off in ObjectNav and PersONAL.
            prompts: The searches of a home sequence; () = an episode.
        """
        self.camera = camera
        self.max_steps = max_steps
        self._start = episode_start
        self._navigation = navigation
        self._renderer = renderer
        self._colours = colours
        self._allow_sliding = allow_sliding
        self._prompts = tuple(prompts)
        self._steps: list[Step] = []
        self._ends: list[int] = []
        """Number of steps at the end of each search that is over."""
        self._reasons: list[EndReason] = []
        """Why each of these ended; `stop` also where it was FOUND."""

    @classmethod
    def in_home(
        cls,
        home: Scene,
        episode: Episode,
        *,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
        pictures: bool = True,
    ) -> Self:
        """The environment of one episode in its home (`open_home`); only the episode's start is used.

        The home's renderer draws the views; without `pictures` nothing is drawn.

        Raises:
            SceneError: The episode takes place in another home.
        """
        if home.name != episode.key.scene:
            raise SceneError(
                f"{episode.key}: got the home {home.name!r}; expected its own. Open {episode.key.scene!r}."
            )
        if not pictures:
            return cls(episode.start, home.navigation, renderer=None, camera=camera)
        from sim.homes.renderers import renderer_of

        return cls(episode.start, home.navigation, renderer=renderer_of(home), camera=camera)

    @property
    def pose(self) -> Pose:
        """The robot's current pose."""
        return self._steps[-1].pose if self._steps else self._start

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Start pose and the pose after each action."""
        return (self._start, *(step.pose for step in self._steps))

    @property
    def steps(self) -> tuple[Step, ...]:
        """The actions so far, each with its result."""
        return tuple(self._steps)

    @property
    def search_ends(self) -> tuple[int, ...]:
        """Number of steps at the end of each search that is over; an episode is one search."""
        return tuple(self._ends)

    @property
    def search_reasons(self) -> tuple[EndReason, ...]:
        """Why each search that is over ended: `stop` for FOUND too, `steps`, or what `end_search` was told."""
        return tuple(self._reasons)

    @property
    def end_reason(self) -> EndReason | None:
        """`stop` or `steps` once the episode is over, None before; in a sequence, why its last search ended."""
        if self._steps and self._steps[-1].action is Action.STOP:
            return "stop"
        return self._reasons[-1] if len(self._ends) >= max(1, len(self._prompts)) else None

    @property
    def is_over(self) -> bool:
        """Whether no further action is taken."""
        return self.end_reason is not None

    def reset(self) -> Observation:
        """Puts the robot back at the start."""
        self._steps, self._ends, self._reasons = [], [], []
        return self.observe()

    def restore(self, steps: Sequence[Step], *, left: Sequence[tuple[int, EndReason]] = ()) -> Observation:
        """Restores the state after `steps`, which an equal environment took before.

        Args:
            steps: The steps.
            left: Each call of `end_search` in between: after how many steps, and its reason.

        Raises:
            TaskStateError: There are steps after the end, or FOUND in an episode.
        """
        self._steps, self._ends, self._reasons = [], [], []
        for number in range(len(steps) + 1):
            for _, reason in (one for one in left if one[0] == number):
                self.end_search(reason)
            if number < len(steps):
                self._require_takes(steps[number].action)
                self._take(steps[number])
        return self.observe()

    def end_search(self, reason: EndReason) -> None:
        """Ends the present search of a home sequence without a step; the next one begins where the robot stands.

        Raises:
            TaskStateError: The sequence is over, or it is an episode.
        """
        if self.is_over or not self._prompts:
            raise TaskStateError(
                f"step {len(self._steps)}: found {reason!r} {'after the end' if self.is_over else 'in an episode'}; "
                "expected it in a search of a home sequence. Call reset() first, or end an episode with 'stop'."
            )
        self._ends.append(len(self._steps))
        self._reasons.append(reason)

    def step(self, action: Action, *, t_s: float = 0.0) -> Observation:
        """Takes one action; `t_s`, seconds since the episode's start, is stored with the step.

        Raises:
            TaskStateError: The episode is over, or it is none of a sequence and the action is FOUND.
        """
        self.move(action, t_s=t_s)
        return self.observe()

    def move(self, action: Action, *, t_s: float = 0.0) -> None:
        """Takes one action without rendering a view; `observe` renders it."""
        self._require_takes(action)
        self._take(self._after(action, t_s))

    def observe(self) -> Observation:
        """The robot's observation now."""
        pose = self.pose
        rgb, depth_m = self._pictures(pose)
        prompt = self._new_prompt()
        return Observation(
            rgb=rgb,
            depth_m=depth_m,
            gps=gps_from_poses(self._start, pose),
            compass=wrap_angle(pose.yaw - self._start.yaw),
            T_start_camera=T_start_camera(self._start, pose, self.camera),
            camera=self.camera,
            collided=self._steps[-1].collided if self._steps else False,
            step=len(self._steps),
            message=prompt.message if prompt else None,
            query=prompt.query if prompt else None,
        )

    def _require_takes(self, action: Action) -> None:
        if self.is_over:
            raise TaskStateError(
                f"step {len(self._steps) + 1}: found action {action.value!r} after the end ({self.end_reason}); "
                "expected reset() first."
            )
        if action is Action.FOUND and not self._prompts:
            raise TaskStateError(
                f"step {len(self._steps) + 1}: found action 'found' in an episode; expected it in home sequences only. "
                "End an episode with 'stop'."
            )

    def _take(self, step: Step) -> None:
        """Adds a step, and ends the search that it ends."""
        begin, index = self._ends[-1] if self._ends else 0, len(self._ends)
        before = self._steps[-1].action if len(self._steps) > begin else None
        self._steps.append(step)
        is_found = step.action is Action.FOUND and (not self._prompts[index].is_for_all or before is Action.FOUND)
        if is_found or step.action is Action.STOP or len(self._steps) - begin >= self.max_steps:
            self._ends.append(len(self._steps))
            self._reasons.append("stop" if is_found or step.action is Action.STOP else "steps")

    def _new_prompt(self) -> Prompt | None:
        """The prompt of a search that begins now."""
        is_new = len(self._steps) == (self._ends[-1] if self._ends else 0)
        return self._prompts[len(self._ends)] if is_new and self._prompts and not self.is_over else None

    def _pictures(self, pose: Pose) -> tuple[NDArray[np.uint8] | None, NDArray[np.float32] | None]:
        """Colours and depth of the camera's view at a pose, as far as they are wanted."""
        if self._renderer is None:
            return None, None
        if not self._colours:
            return None, self._renderer.depth(T_world_camera(pose, self.camera), self.camera)
        frame = self._renderer.render(T_world_camera(pose, self.camera), self.camera)
        return frame.rgb, frame.depth_m

    def _after(self, action: Action, t_s: float) -> Step:
        """The step that `action` makes from the current pose (semantics: HABITAT_SEMANTICS.md 2.1)."""
        pose = self.pose
        position, yaw, tilt, collided = pose.position, pose.yaw, pose.tilt, False
        match action:
            case Action.FORWARD:
                start = np.array(position)
                end = start + FORWARD_STEP * forward_from_yaw(yaw)
                position, collided = self._navigation.step(start, end, slide=self._allow_sliding)
            case Action.LEFT:
                yaw = wrap_angle(yaw + TURN_STEP)
            case Action.RIGHT:
                yaw = wrap_angle(yaw - TURN_STEP)
            case Action.LOOK_UP:
                tilt = wrap_angle(tilt + TURN_STEP)
            case Action.LOOK_DOWN:
                tilt = wrap_angle(tilt - TURN_STEP)
            case Action.STOP | Action.FOUND:
                pass
        return Step(action=action, position=position, yaw=yaw, tilt=tilt, collided=collided, t_s=t_s)
