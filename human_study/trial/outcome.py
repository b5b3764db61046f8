"""The outcome of a trial, rebuilt from its stored events: an `EpisodeRun` (PAN) or an `Answer` (POG) with measures.

Measures need the goal, so this runs on the server only, after the trial's last event is stored. `verify` and `export`
call the same functions: there is one way from events to a result.
"""

import math
from collections.abc import Callable, Iterator, Sequence

from sim.episodes.schema import Episode
from sim.errors import StudyError
from sim.sequences.runs import SequenceEnd
from sim.tasks.rules import score_answer, score_run
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, EpisodeStart, Step, Vector3
from sim.types import Action, EndReason, EpisodeKey, TaskKind
from sim.walk.navigation_map import NavigationMap

from .events import Abandoned, Act, Clicked, Error, Event, MapOff, Moment, Open, SearchBegun, Shown, TimedOut

Outcome = EpisodeEnd | Answer | SequenceEnd
"""The outcome that the store keeps: a PAN run's end (its steps are the events), a whole POG answer, or the end of a
sequence. An unscored sequence has that of an episode."""
HIT_TOLERANCE = 1e-6
"""Largest distance between a stored point on a map and its pixel's point, metres: only rounding."""


def opening(events: Sequence[Event]) -> Open:
    """The trial's first event.

    Raises:
        StudyError: The trial has no events, or does not begin with `open`.
    """
    first = events[0] if events else None
    if not isinstance(first, Open):
        found = first.kind if first else "no event"
        raise StudyError(f"trial: starts with {found!r}; expected 'open'. Run personal-viz study check-db.")
    return first


def has_begun(events: Sequence[Event]) -> bool:
    """Whether the trial has its first event; a trial that failed earlier or was never opened has no figures."""
    return bool(events) and isinstance(events[0], Open)


def end_reason(events: Sequence[Event]) -> EndReason | None:
    """The reason why the trial is over; None while it is running.

    Raises:
        StudyError: The trial does not begin with `open`.
    """
    end = trial_end(events)
    return end[1] if end is not None else None


def trial_end(events: Sequence[Event]) -> tuple[Event, EndReason] | None:
    """The event that ended the trial, and the reason; None while it is running. Later events change no result.

    Raises:
        StudyError: The trial does not begin with `open`.
    """
    return next(((event, reason) for event, reason, is_last in _each_end(events) if is_last), None)


def search_ends(events: Sequence[Event]) -> tuple[tuple[Event, EndReason], ...]:
    """The same for each search of a home sequence that is over, in order; an episode is one search.

    Raises:
        StudyError: The trial does not begin with `open`.
    """
    found = []
    for event, reason, is_last in _each_end(events):
        found.append((event, reason))
        if is_last:
            break
    return tuple(found)


def left_searches(events: Sequence[Event]) -> tuple[tuple[int, EndReason], ...]:
    """The searches of a home sequence that ended without a step: the number of steps before that, and the reason."""
    if not any(isinstance(event, SearchBegun) for event in events):
        return ()
    ends = {id(event): reason for event, reason in search_ends(events) if reason in ("giveup", "timeout")}
    num_steps, found = 0, []
    for event in events:
        num_steps += isinstance(event, Act)
        if id(event) in ends:
            found.append((num_steps, ends[id(event)]))
    return tuple(found)


def _each_end(events: Sequence[Event]) -> Iterator[tuple[Event, EndReason, bool]]:
    """Each event that ends a search or the trial, the reason, and whether it ends the trial."""
    opened = opening(events)
    num_steps, search, was_found = 0, None, False
    for event in events:
        if isinstance(event, SearchBegun) and (search is None or event.search != search.search):
            num_steps, search, was_found = 0, event, False
        num_steps += isinstance(event, Act)
        is_found = isinstance(event, Act) and event.action is Action.FOUND
        marks = is_found and search is not None and search.is_for_all and not was_found
        reason = _ends(event, is_last_step=num_steps >= opened.max_steps, is_found=is_found and not marks)
        was_found = is_found if isinstance(event, Act) else was_found
        if reason is not None:
            is_more = search is not None and search.search + 1 < search.num_searches
            yield event, reason, not is_more or reason in ("technical", "abandoned")


def _ends(event: Event, *, is_last_step: bool, is_found: bool) -> EndReason | None:
    """The reason why this event ends its trial or search; None when it does not."""
    match event:
        case Moment(kind="giveup"):
            return "giveup"
        case TimedOut():
            return "timeout"
        case Abandoned():
            return "abandoned"
        case Moment(kind="confirm"):
            return "click"
        case Error(is_fatal=True):
            return "technical"
        case Act(action=Action.STOP):
            return "stop"
        case Act() if is_found:
            return "stop"
        case Act():
            return "steps" if is_last_step else None
        case _:
            return None


def pan_outcome(
    events: Sequence[Event], episode: Episode, *, navigation: NavigationMap, participant: str
) -> EpisodeRun:
    """The finished PAN trial; it has measures unless we failed or the participant never came back.

    Raises:
        StudyError: The trial is not over, is a POG trial, or has another episode.
    """
    opened, reason = finished(events, episode.key, "pan")
    run = episode_run(events, end=EpisodeEnd(reason=reason), participant=participant)
    if _is_unscored(events):
        return run
    measures = score_run(
        episode,
        run.poses,
        stopped=reason == "stop",
        navigation=navigation,
        collisions=sum(step.collided for step in run.steps),
        scene_digest=opened.scene_digest,
    )
    return run.model_copy(update={"end": EpisodeEnd(reason=reason, measures=measures)})


def pog_outcome(
    events: Sequence[Event], episode: Episode, *, storeys: Sequence[tuple[float, float]], participant: str
) -> Answer:
    """The finished POG trial with its measures; without candidates unless the participant confirmed a point.

    It has no measures if we failed or the participant never came back. Each of `storeys` is (lowest, highest) floor,
    from `sim.tasks.rules.scene_storeys`.

    Raises:
        StudyError: The trial is not over, is a PAN trial, or has another episode, or a map point is not its pixel's.
    """
    opened, reason = finished(events, episode.key, "pog")
    require_own_points(events)
    if _is_unscored(events):
        outcome = unscored_outcome(episode.key, "pog", reason=reason, participant=participant)
        assert isinstance(outcome, Answer)
        return outcome
    marked = last_marked(events) if reason == "click" else None
    candidates = (marked.mark,) if marked is not None and marked.mark is not None else ()
    end = trial_end(events)
    ended_s = end[0].t_s if end is not None else None
    return Answer(
        split=opened.split,
        scene=opened.scene,
        episode_id=opened.episode_id,
        candidates=candidates,
        participant=participant,
        ray=marked.ray if marked is not None else None,
        t_s=None if ended_s is None else ended_s - task_began_s(events),
        reason=reason,
        measures=score_answer(episode, candidates, storeys=storeys).model_copy(
            update={"on_object": _is_on_target(marked, episode) if opened.knows_objects else None}
        ),
    )


def unscored_outcome(key: EpisodeKey, task: TaskKind, *, reason: EndReason, participant: str) -> Outcome:
    """The end of a trial without measures, which never counts: our failure, or a participant who never came back."""
    if task == "pan":
        return EpisodeEnd(reason=reason)
    return Answer(
        split=key.split,
        scene=key.scene,
        episode_id=key.episode_id,
        candidates=(),
        participant=participant,
        reason=reason,
    )


def episode_run(events: Sequence[Event], *, end: EpisodeEnd, participant: str) -> EpisodeRun:
    """A PAN trial's events as a run with the given end.

    Raises:
        StudyError: The trial does not begin with `open`, or is a POG trial.
    """
    opened = opening(events)
    if opened.position is None or opened.yaw is None:
        raise StudyError(f"trial of {opened.key}: has no start pose; expected a PAN trial. Give a trial of task pan.")
    start = EpisodeStart(
        split=opened.split,
        scene=opened.scene,
        episode_id=opened.episode_id,
        position=opened.position,
        yaw=opened.yaw,
        participant=participant,
    )
    return EpisodeRun(start=start, steps=walked_steps(events), end=end)


def task_began_s(events: Sequence[Event]) -> float:
    """Start of the task itself, on the trial's clock: the robot's first picture (PAN) or the texts (POG).

    In some conditions a look at a map or the home comes first; without a look the start is 0.
    """
    for event in events:
        if isinstance(event, MapOff | Shown) and event.t_s is not None:
            return event.t_s
    return 0.0


def walked_steps(events: Sequence[Event]) -> tuple[Step, ...]:
    """The robot's steps; their `t_s` counts from the first picture, so that an earlier look at the map is left out."""
    began_s = task_began_s(events)
    steps = (event.step for event in events if isinstance(event, Act))
    return tuple(step.model_copy(update={"t_s": max(0.0, step.t_s - began_s)}) for step in steps)


PointAt = Callable[[float, Vector3, Vector3], Vector3 | None]
"""(storey's floor height, ray's origin, direction) -> world point that the ray meets, or None."""
ObjectAt = Callable[[float, Vector3, Vector3], tuple[str, Vector3] | None]
"""The same -> name of the object that the ray meets, and the middle to which a mark goes; None = it meets no object."""


def largest_click_error(events: Sequence[Event], cast: PointAt, object_at: ObjectAt | None = None) -> float:
    """Largest distance of the stored points of clicks from those that their rays give, metres.

    Clicks on the 3-D home have the point that the ray meets, and all clicks may have the middle of an object. The
    result is inf where only one of the two points exists or the ray meets another object, and 0 without clicks.
    """
    errors = [0.0]
    for event in events:
        if isinstance(event, Clicked) and event.pixel is None:
            errors.append(_apart(cast(event.ray.storey_y, event.ray.origin, event.ray.direction), event.hit))
        if isinstance(event, Clicked) and object_at is not None and opening(events).knows_objects:
            name, middle = object_at(event.ray.storey_y, *event.object_ray) or (None, None)
            errors.append(0.0 if name == event.object_name else math.inf)
            errors.append(_apart(middle, event.snapped) if event.snapped is not None else 0.0)
    return max(errors)


def _apart(found: Vector3 | None, stored: Vector3 | None) -> float:
    """Distance of two points, metres; inf where only one exists, 0 where none does."""
    if found is None or stored is None:
        return 0.0 if found is stored else math.inf
    return math.dist(found, stored)


def _is_on_target(marked: Clicked | None, episode: Episode) -> bool:
    """Whether the confirmed click met a target; no answer met none."""
    return marked is not None and marked.object_name in {target.object_name for target in episode.targets}


def last_marked(events: Sequence[Event]) -> Clicked | None:
    """The last click that met the scene; None when there is none."""
    return next((event for event in reversed(events) if isinstance(event, Clicked) and event.hit is not None), None)


def require_own_points(events: Sequence[Event]) -> None:
    """Raises StudyError when a point on the map is not its pixel's point."""
    for event in events:
        if not isinstance(event, Clicked) or event.pixel is None:
            continue
        found = event.pixel.point(event.ray.storey_y)
        if event.hit is None or math.dist(found, event.hit) > HIT_TOLERANCE:
            raise StudyError(
                f"trial of pog {opening(events).key}: a click's point is {event.hit}; expected {found}, the place of "
                f"its pixel {event.pixel.uv}. Run personal-viz study check-db."
            )


def finished(events: Sequence[Event], key: EpisodeKey, task: TaskKind | None = None) -> tuple[Open, EndReason]:
    """The opening and the end of a trial of this episode or sequence; `task` = the trial's own.

    Raises:
        StudyError: It is not such a trial, or is not over.
    """
    opened, reason = opening(events), end_reason(events)
    task = task or opened.task
    if opened.task != task or opened.key != key:
        raise StudyError(
            f"trial of {opened.task} {opened.key}: asked for the outcome of {task} {key}; expected its own. "
            "Give the trial's own task and episode."
        )
    if reason is None:
        raise StudyError(
            f"trial of {task} {opened.key}: is not over after {len(events)} events; expected its end. "
            "Let the participant finish it first."
        )
    return opened, reason


def _is_unscored(events: Sequence[Event]) -> bool:
    """Whether the end is no result: our failure, or a participant who never came back.

    For the latter the store writes the end, without a time; it knows no targets. Participants who come back too late
    are scored like all others.
    """
    end = trial_end(events)
    if end is None:
        return False
    event, reason = end
    return reason == "technical" or (reason == "abandoned" and event.t_s is None)
