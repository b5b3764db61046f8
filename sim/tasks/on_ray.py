"""Ray as workers: one actor per chain of calls (a home), kept warm; what a lost worker was doing is done again."""

import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeVar

from sim.errors import PersonalVizError
from sim.extras import require

MOST_LOSSES = 4
"""How often a home's work begins again with another worker; a home that ends each of them is given up."""
ENVIRONMENT = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_NUM_REDIS_GET_RETRIES": "1", "RAY_worker_niceness": "0"}
"""What Ray reads, unless the user has set it: it reports no use to others, tries a silent address for 40 s, not for 13
minutes, and the workers of a cluster that begins here wait for nobody: by its own niceness of 15 they hardly ran
beside other work."""
_OURS = "PERSONAL_VIZ_"
"""How the names of our environment variables begin: workers get this process's values."""
_ANSWER_S = 10.0
"""Longest wait for the cluster's machine to answer."""
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class RayCluster:
    """The Ray cluster that does the work; its machines hold this program and the same files at the same places."""

    address: str | None = None
    """HOST:PORT of its head, or `auto`; None = RAY_ADDRESS, a cluster on this machine, or a new one that ends with the
    work."""
    num_gpus: float = 0.0
    """Graphics cards, or a share of one, that each worker needs."""


class _Worker:
    """Does calls in the driver's folder, so that relative paths name the same files."""

    def __init__(self, folder: str, environment: Mapping[str, str]) -> None:
        os.chdir(folder)
        os.environ.update(environment)

    def do(self, work: Callable[..., Result], arguments: Sequence[Any]) -> Result:
        return work(*arguments)


def done_on_ray(
    cluster: RayCluster, work: Callable[..., Result], chains: Sequence[Sequence[Sequence[Any]]], *, names: Sequence[str]
) -> Iterator[tuple[int, int, Result]]:
    """Yields (chain, place in the chain, result) of each call of `work`, in the order in which calls end.

    Each chain has one worker of one core, which does its calls in order, as soon as the cluster has a core for it. The
    call that a lost worker had not ended is done again by a new one, at once: with Ray's own repetition of an actor's
    calls the tests with losses took three times as long. No ended call is done twice, unless the machine with a large
    result is lost before the result has come here.

    Args:
        cluster: The cluster.
        work: A module-level function.
        chains: The arguments of each call, by chain.
        names: What errors call each chain, such as its home.

    Raises:
        MissingDependencyError: Ray is not installed.
        PersonalVizError: The cluster cannot be reached, no machine has the graphics card it needs, a home's workers
            were lost more than `MOST_LOSSES` times, or `work` raised it.
    """
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    ray = require("ray", extra="ray")
    with _connected(ray, cluster):
        _require_gpu(ray, cluster)
        new_worker = ray.remote(num_cpus=1, num_gpus=cluster.num_gpus)(_Worker)
        todo = [_Chain(work, calls) for calls in chains]
        waiting = {chain.begin(new_worker): k for k, chain in enumerate(todo) if chain.calls}
        try:
            while waiting:
                (ended,), _ = ray.wait(list(waiting), num_returns=1)
                k = waiting.pop(ended)
                chain, place = todo[k], todo[k].place
                try:
                    result = ray.get(ended)
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from (None if isinstance(error.cause, PersonalVizError) else error)
                except ray.exceptions.RayError as error:
                    chain.losses += 1
                    _require_few(names[k], chain.losses, error)
                    chain.end(ray)
                    waiting[chain.begin(new_worker)] = k
                    continue
                chain.place += 1
                if chain.place < len(chain.calls):
                    waiting[chain.begin(new_worker)] = k
                else:
                    chain.end(ray)  # its core is for the next home
                yield k, place, result
        finally:
            for chain in todo:
                chain.end(ray)


@dataclass(slots=True)
class _Chain:
    """Calls in order, and the worker that does them."""

    work: Callable[..., Any]
    calls: Sequence[Sequence[Any]]
    place: int = 0
    """Of the call that is done next, or now."""
    losses: int = 0
    """Workers that were lost."""
    worker: Any = None

    def begin(self, new_worker: Any) -> Any:
        """Lets the worker, or a new one, do the next call; returns the reference to its result."""
        if self.worker is None:
            environment = {name: value for name, value in os.environ.items() if name.startswith(_OURS)}
            self.worker = new_worker.remote(os.getcwd(), environment)
        return self.worker.do.remote(self.work, tuple(self.calls[self.place]))

    def end(self, ray: ModuleType) -> None:
        """Ends the worker if there is one."""
        if self.worker is not None:
            ray.kill(self.worker)
            self.worker = None


def _require_gpu(ray: ModuleType, cluster: RayCluster) -> None:
    """Refuses work that needs a graphics card where there is none: Ray would wait for one for ever."""
    if ray.cluster_resources().get("GPU", 0.0) < cluster.num_gpus:
        raise PersonalVizError(
            "--on ray: no machine of the cluster has a graphics card; expected one, because --device cuda was given. "
            "Add one with `ray start --num-gpus 1`, or give --device cpu."
        )


def _require_few(name: str, losses: int, error: Exception) -> None:
    """Gives up a chain whose workers were lost too often."""
    if losses > MOST_LOSSES:
        raise PersonalVizError(
            f"--on ray: the worker of {name} was lost {losses} times ({type(error).__name__}: {_first_line(error)}); "
            "expected it to finish. Memory ran out, or a machine lacks this folder or this program: correct it and run "
            "again, finished episodes are kept."
        ) from None


@contextmanager
def _connected(ray: ModuleType, cluster: RayCluster) -> Iterator[None]:
    """Connects for a block, unless this process is connected already.

    Raises:
        PersonalVizError: No cluster answers, or one with another version of Python or Ray.
    """
    if ray.is_initialized():
        yield
        return
    if cluster.address is not None:
        _require_answer(cluster.address)
    try:
        ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR", include_dashboard=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise PersonalVizError(
            f"--on ray: {cluster.address or 'a cluster on this machine'} cannot be used ({_first_line(error)}); "
            "expected a cluster of the same Python and Ray. Give --address HOST:PORT, as `ray start --head` prints it."
        ) from None
    try:
        yield
    finally:
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Refuses HOST:PORT where nothing listens, before Ray tries it for long."""
    host, colon, port = address.rpartition(":")
    if address in ("auto", "local") or "/" in address:  # names that Ray resolves
        return
    try:
        if not colon or not port.isdigit():
            raise OSError("it is not HOST:PORT")
        socket.create_connection((host, int(port)), timeout=_ANSWER_S).close()
    except (OSError, OverflowError) as error:
        raise PersonalVizError(
            f"--address is {address!r} ({error}); expected HOST:PORT of a running cluster. Start one with "
            "`ray start --head --port 6379`, or give the address that this prints."
        ) from None


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
