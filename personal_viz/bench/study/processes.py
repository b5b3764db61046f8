"""What the serving processes of a study hold: files, threads, connections, memory."""

import contextlib

import psutil
from pydantic import BaseModel, ConfigDict


class Held(BaseModel):
    """Sums over the serving process and its workers."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    processes: int
    fds: int
    """Open file descriptors."""
    threads: int
    clients: int
    """Established TCP connections of the workers: viser's clients."""
    rss_mb: float
    """Resident memory, MB of 10^6 bytes; pages that processes share count in each."""
    peak_mb: float
    """Sum of the largest resident memory that each of the processes ever had."""


def held_by(pid: int) -> Held:
    """What a serving process and its workers hold now; a process that ends meanwhile counts for nothing."""
    found: list[Held] = []
    with contextlib.suppress(psutil.NoSuchProcess):
        serving = psutil.Process(pid)
        for process in (serving, *serving.children()):
            with contextlib.suppress(psutil.NoSuchProcess):
                found.append(_held_by_one(process, is_worker=process.pid != pid))
    totals = {name: sum(getattr(one, name) for one in found) for name in Held.model_fields}
    return Held(**totals)


def peak_mb(process: psutil.Process) -> float:
    """The largest resident memory of a process so far, MB of 10^6 bytes; where nothing tells it, the present one."""
    try:
        with open(f"/proc/{process.pid}/status") as file:
            return next(int(line.split()[1]) * 1024 / 1e6 for line in file if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return process.memory_info().rss / 1e6


def _held_by_one(process: psutil.Process, *, is_worker: bool) -> Held:
    connections = process.net_connections("tcp") if is_worker else []
    return Held(
        processes=1,
        fds=process.num_fds(),
        threads=process.num_threads(),
        clients=sum(connection.status == psutil.CONN_ESTABLISHED for connection in connections),
        rss_mb=process.memory_info().rss / 1e6,
        peak_mb=peak_mb(process),
    )
