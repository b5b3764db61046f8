"""What the serving processes of a study hold: files, threads, connections, memory."""

import contextlib
from collections import Counter

import psutil

from ..harness import peak_mb


def held_by(pid: int) -> dict[str, float]:
    """What a serving process and its workers hold now; a process that ends meanwhile counts for nothing.

    Returns:
        Sums: `processes`, `fds` (open file descriptors), `threads`, `clients` (established TCP connections of the
        workers: viser's clients), `rss_mb` (resident memory, MB of 10^6 bytes; pages that processes share count in
        each), `peak_mb` (the largest that each of the processes ever had).
    """
    held = Counter[str](processes=0, fds=0, threads=0, clients=0)
    with contextlib.suppress(psutil.NoSuchProcess):
        serving = psutil.Process(pid)
        for process in (serving, *serving.children()):
            with contextlib.suppress(psutil.NoSuchProcess):
                connections = process.net_connections("tcp") if process.pid != pid else []
                established = sum(connection.status == psutil.CONN_ESTABLISHED for connection in connections)
                held.update(processes=1, fds=process.num_fds(), threads=process.num_threads(), clients=established)
                held.update(rss_mb=process.memory_info().rss / 1e6, peak_mb=peak_mb(process))  # pyright: ignore
    return dict(held)
