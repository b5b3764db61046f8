"""What one attempt at a trial came to, as plain figures from its events and its outcome."""

from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict

from sim.tasks.run_files import EpisodeEnd
from sim.types import EndReason, SuccessRule

from ..trial.events import Act, Confidence, Event, Hidden, MapOff, MapOn, Open, Shown
from ..trial.outcome import Outcome, has_begun, trial_end
from .data_dictionary import Unit

Seconds = Annotated[float, Unit("s")]
Metres = Annotated[float, Unit("m")]


class TrialFigures(BaseModel):
    """What a trial's events and outcome say, without anything about the person."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    end_reason: EndReason | None
    """How the trial ended; empty while it has not."""
    success: bool | None
    """Under the success rule of the study file; empty without a result, or where the rule is undefined."""
    spl: Annotated[float, Unit("share")] | None
    """Success weighted by path length, 0 to 1; PAN only."""
    softspl: Annotated[float, Unit("share")] | None
    """Progress to the target weighted by path length, 0 to 1; PAN only."""
    dtg: Metres | None
    """Walking distance left to the rule's success region at the end, 0 inside; PAN only, empty when unreachable."""
    planar_distance: Metres | None
    """From the last position or the answer to the nearest valid target's middle, on the floor plan."""
    n_steps: Annotated[int, Unit("steps")] | None
    """Actions, STOP included; PAN only."""
    path_m: Metres | None
    """Length of the robot's way; PAN only."""
    t_total_s: Seconds | None
    """From the trial's start to its end, however it ended, without time away; includes the look at a map. The report's
    time to decision is this minus `t_look_s`."""
    t_look_s: Seconds | None
    """How long the map or home was shown before the task; empty when nothing was to be shown."""
    t_hidden_s: Seconds
    """How long the page was in the background."""
    t_first_view_s: Seconds | None
    """From the trial's start to the robot's first picture; PAN only."""
    confidence: int | None
    """How sure the participant was: 1 (guessed) to 5 (certain); empty when not asked or not told."""


def trial_figures(events: Sequence[Event], outcome: Outcome | None, *, rule: SuccessRule) -> TrialFigures:
    """The figures of one attempt.

    Args:
        events: All of the attempt, in order; () when it was never opened. Those of an attempt that failed before its
            first event `open` have no figures.
        outcome: Of the store, or recomputed; None while it has not ended.
        rule: Success rule of PAN.
    """
    acts = [event for event in events if isinstance(event, Act)]
    end = trial_end(events) if has_begun(events) and outcome is not None else None
    is_pan = bool(events) and isinstance(events[0], Open) and events[0].task == "pan"
    figures = TrialFigures(
        end_reason=outcome.reason if outcome is not None else None,
        success=None,
        spl=None,
        softspl=None,
        dtg=None,
        planar_distance=None,
        n_steps=len(acts) if is_pan else None,
        path_m=None,
        t_total_s=end[0].t_s if end is not None else None,
        t_look_s=_look_time(events),
        t_hidden_s=_hidden_time(events),
        t_first_view_s=next((event.t_s for event in events if isinstance(event, Shown)), None),
        confidence=next((event.value for event in reversed(events) if isinstance(event, Confidence)), None),
    )
    return figures.model_copy(update=measured(outcome, rule))


def measured(outcome: Outcome | None, rule: SuccessRule) -> dict[str, float | None]:
    """The figures that come from the outcome's measures; {} without any."""
    if outcome is None or outcome.measures is None:
        return {}
    if not isinstance(outcome, EpisodeEnd):
        return {"success": outcome.measures.success, "planar_distance": outcome.measures.planar_distance}
    measures = outcome.measures
    found: dict[str, float | None] = {
        "planar_distance": measures.centre_distance,
        "n_steps": measures.num_steps,
        "path_m": measures.path_m,
    }
    ruled = measures.rules[rule]
    if ruled is not None:
        found |= {"success": ruled.success, "spl": ruled.spl, "softspl": ruled.soft_spl, "dtg": ruled.dtg}
    return found


def _look_time(events: Sequence[Event]) -> float | None:
    """How long a map was shown; a look that was cut off counts until the last event of it."""
    if not any(isinstance(event, MapOn) for event in events):
        return None
    ended = [event.look_s for event in events if isinstance(event, MapOff)]
    if ended:
        return sum(ended)
    times = [event.t_s for event in events if event.t_s is not None]
    first = next(event.t_s for event in events if isinstance(event, MapOn))
    return max(times) - first if first is not None else None


def _hidden_time(events: Sequence[Event]) -> float:
    """How long the page was in the background: from each `hidden` to the next event that needs the page, or the end."""
    total, since = 0.0, None
    for event in events:
        if event.t_s is None:
            continue
        if isinstance(event, Hidden):
            since = event.t_s if since is None else since
        elif since is not None and event.kind in ("visible", "reconnect", "abandoned"):
            total, since = total + event.t_s - since, None
    times = [event.t_s for event in events if event.t_s is not None]
    return total + (max(times) - since if since is not None else 0.0)
