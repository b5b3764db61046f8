"""Computes how long a pause between two sittings still lasts, even if the server's wall clock is changed meanwhile."""

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from human_study.journey import StageEntry

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""A steady clock; where possible it also counts the time for which the machine slept, since a rest goes on then."""
_STEADY = "steady"
"""Key in a stage's detail. The boot and its clock are one text, because exports keep the numbers of a detail, and this
one says nothing about the participant."""


@dataclass(frozen=True, slots=True)
class MachineTime:
    """The times of the machine's clocks."""

    wall_ns: int
    """The wall clock, which can be set forwards and backwards."""
    since_boot_ns: int
    """The steady clock, which cannot be set and begins anew with each boot."""
    boot_id: str | None
    """Name of the boot; None = this system has no such names."""


def machine_time() -> MachineTime:
    """The present times."""
    boot_id = None
    with suppress(OSError):
        boot_id = _BOOT_ID.read_text().strip()
    return MachineTime(time.time_ns(), time.clock_gettime_ns(_CLOCK), boot_id)


def steady_detail(now: MachineTime) -> dict[str, str]:
    """The detail to store with the stage that begins a pause."""
    return {} if now.boot_id is None else {_STEADY: f"{now.boot_id} {now.since_boot_ns}"}


def pause_left_s(began: StageEntry, gap_s: float, now: MachineTime) -> float:
    """Seconds until a pause is over, from 0 to its whole length.

    Within one boot the steady clock counts alone. Over a restart of the machine only the wall clock is left; the pause
    began before the boot, so at least the time since then has passed.

    Args:
        began: The stage with which it began, its detail with `steady_detail`.
        gap_s: Length of the pause, seconds.
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
