"""How long a pause between two sittings still lasts, whatever happens to the server's wall clock meanwhile."""

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from human_study.store.stages import StageEntry

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""Steady; where the system can, it counts the time for which the machine slept too: a rest goes on meanwhile."""
_STEADY = "steady"
"""Name in a stage's detail: the boot and its clock as one text, because exports keep the numbers of a detail, and this
is none of the participant's."""


@dataclass(frozen=True, slots=True)
class MachineTime:
    """What the clocks of the machine say."""

    wall_ns: int
    """Can be set, forwards and backwards."""
    since_boot_ns: int
    """Cannot; begins anew with each boot."""
    boot_id: str | None
    """None = this system has no name for its boots."""


def machine_time() -> MachineTime:
    """Now."""
    boot_id = None
    with suppress(OSError):
        boot_id = _BOOT_ID.read_text().strip()
    return MachineTime(time.time_ns(), time.clock_gettime_ns(_CLOCK), boot_id)


def steady_detail(now: MachineTime) -> dict[str, str]:
    """What is stored with the stage that begins a pause."""
    return {} if now.boot_id is None else {_STEADY: f"{now.boot_id} {now.since_boot_ns}"}


def pause_left_s(began: StageEntry, gap_s: float, now: MachineTime) -> float:
    """Seconds until a pause is over, from 0 to its whole length.

    Within one boot the steady clock counts alone. Over a restart of the machine only the wall clock is left; the pause
    began before the boot, so at least the time since then has passed.

    Args:
        began: The stage with which it began, its detail with `steady_detail`.
        gap_s: How long it is.
        now: The machine's clocks.
    """
    boot_id, _, since_boot = str(began.detail.get(_STEADY, "")).rpartition(" ")
    if boot_id and boot_id == now.boot_id:
        passed_ns = now.since_boot_ns - int(since_boot)
    else:
        passed_ns = now.wall_ns - began.at_ns
        if boot_id and now.boot_id is not None:
            passed_ns = max(passed_ns, now.since_boot_ns)
    return min(gap_s, max(0.0, gap_s - passed_ns / 1e9))
