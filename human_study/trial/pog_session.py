"""POG as a state machine: an optional look at the home, then the texts; place a mark, move it, confirm it."""

from collections.abc import Sequence

from sim.tasks.run_files import Vector3
from sim.types import EpisodeKey, Task

from .commands import Click, Command, Confirm
from .events import Clicked, Confirmed, Dropped, Event, Open, ShownStorey
from .outcome import last_marked
from .terms import TrialTerms
from .trial_session import TrialSession
from .views import PogView

_NO_TERMS = TrialTerms()


class PogSession(TrialSession[PogView]):
    """One participant pointing in one POG trial; shows the lowest storey first."""

    def __init__(
        self,
        *,
        key: EpisodeKey,
        task: Task,
        storeys: tuple[float, ...],
        scene_digest: str,
        terms: TrialTerms = _NO_TERMS,
    ) -> None:
        """Shows nothing before `Start`; the arguments are those of TrialSession."""
        super().__init__(key=key, task=task, storeys=storeys, scene_digest=scene_digest, terms=terms)
        self._marker: Vector3 | None = None

    def _open_event(self, t_s: float) -> Open:
        return self._opened().model_copy(update={"t_s": t_s})

    def _show_task(self, t_s: float, *, again: bool = False) -> tuple[Event, ...]:
        if not again:
            return ()
        return (ShownStorey(t_s=t_s, storey_y=self._storeys[self._storey]),)

    def _task_view(self, t_s: float) -> PogView:
        return PogView(
            task=self._task,
            storeys=self._storeys,
            storey=self._storey,
            marker=self._marker,
            is_over=self.is_over,
            is_giving_up=self._is_giving_up(t_s),
            left_s=self._left_s(t_s),
        )

    def _on_task(self, command: Command, t_s: float, *, busy: bool) -> tuple[Event, ...]:
        if self.phase != "task":
            return (Dropped(t_s=t_s, reason="phase"),)
        match command:
            case Click():
                return self._click(command, t_s)
            case Confirm() if self._marker is None:
                return (Dropped(t_s=t_s, reason="nothing_marked"),)
            case Confirm():
                return self._end("click", Confirmed(t_s=t_s))
            case _:
                return (Dropped(t_s=t_s, reason="phase"),)

    def _click(self, command: Click, t_s: float) -> tuple[Event, ...]:
        if self._clock.too_soon(t_s):
            return (Dropped(t_s=t_s, reason="rate"),)
        self._clock.accept(t_s)
        self._marker = command.hit if command.hit is not None else self._marker
        return (Clicked(t_s=t_s, t_cli_ms=command.t_cli_ms, ray=command.ray, hit=command.hit, pixel=command.pixel),)

    def _rebuild(self, events: Sequence[Event]) -> None:
        super()._rebuild(events)
        marked = last_marked(events)
        self._marker = marked.hit if marked is not None else None
