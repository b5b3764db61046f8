"""What the serving processes of a study hold: files, threads, connections, memory; from /proc, so on Linux only."""

import os
import re
from pathlib import Path

from pydantic import BaseModel, ConfigDict

_ESTABLISHED = "01"


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


def held_by(pid: int) -> Held | None:
    """What a serving process and its workers hold now; None where there is no /proc."""
    if not Path("/proc/self/status").exists():
        return None
    workers = children(pid)
    every = [found for one in (pid, *workers) if (found := _status(one)) is not None]
    established = _established()
    return Held(
        processes=len(every),
        fds=sum(len(_fds(one)) for one in (pid, *workers)),
        threads=sum(found["Threads"] for found in every),
        clients=sum(sum(target in established for target in _fds(one)) for one in workers),
        rss_mb=sum(found["VmRSS"] for found in every) * 1024 / 1e6,
        peak_mb=sum(found["VmHWM"] for found in every) * 1024 / 1e6,
    )


def children(pid: int) -> list[int]:
    """Processes that a process has started and that still run, in order."""
    root = Path("/proc")
    every = [int(path.name) for path in root.iterdir() if path.name.isdigit()] if root.is_dir() else []
    return sorted(one for one in every if _parent(one) == pid)


def is_running(pid: int) -> bool:
    """Whether there is such a process that has not ended."""
    fields = _stat(pid)
    return bool(fields) and fields[0] != "Z"


def _parent(pid: int) -> int | None:
    fields = _stat(pid)
    return int(fields[1]) if fields and fields[0] != "Z" else None


def _stat(pid: int) -> list[str]:
    """Fields of /proc/PID/stat behind the name; empty when there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _status(pid: int) -> dict[str, int] | None:
    try:
        text = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return None
    found = dict(re.findall(r"^(Threads|VmRSS|VmHWM):\s+(\d+)", text, re.MULTILINE))
    return {name: int(found.get(name, 0)) for name in ("Threads", "VmRSS", "VmHWM")}


def _fds(pid: int) -> list[str]:
    """What each open file descriptor leads to."""
    targets = []
    try:
        names = os.listdir(f"/proc/{pid}/fd")
    except OSError:
        return []
    for name in names:
        try:
            targets.append(os.readlink(f"/proc/{pid}/fd/{name}"))
        except OSError:
            continue  # closed meanwhile
    return targets


def _established() -> set[str]:
    """`socket:[inode]` of every established TCP connection."""
    found = set()
    for name in ("tcp", "tcp6"):
        path = Path(f"/proc/net/{name}")
        lines = path.read_text().splitlines()[1:] if path.exists() else []
        found |= {f"socket:[{line.split()[9]}]" for line in lines if line.split()[3] == _ESTABLISHED}
    return found
