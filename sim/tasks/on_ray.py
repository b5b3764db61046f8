"""Ray as workers: one actor per chain of calls (a home), kept warm; what a lost worker was doing is done again."""

import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeVar

from sim.cache import VARIABLE
from sim.errors import PersonalVizError
from sim.extras import require

RESTARTS = 4
"""How often a home's worker begins again on another core or machine; a home that ends it each time is given up."""
_ENVIRONMENT = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_NUM_REDIS_GET_RETRIES": "1"}
"""What Ray reads, unless the user has set it: it reports no use to others, and tries a silent address for 40 s, not for
13 minutes."""
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
    cluster: RayCluster, work: Callable[..., Result], chains: Sequence[Sequence[Sequence[Any]]]
) -> Iterator[tuple[int, int, Result]]:
    """Yields (chain, place in the chain, result) of each call of `work`, in the order in which calls end.

    Each chain has one worker of one core, which does its calls in order, as soon as the cluster has a core for it. The
    calls that a lost worker had not ended are done by another one; no ended call is done twice, unless the machine with
    a large result is lost before the result has come here.

    Args:
        cluster: The cluster.
        work: A module-level function.
        chains: The arguments of each call, by chain.

    Raises:
        MissingDependencyError: Ray is not installed.
        PersonalVizError: The cluster cannot be reached, a home's workers were lost `RESTARTS` + 1 times, or `work`
            raised it.
    """
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    ray = require("ray", extra="ray")
    with _connected(ray, cluster):
        options = {"num_cpus": 1, "num_gpus": cluster.num_gpus}
        retries = {
            "max_restarts": RESTARTS,
            "max_task_retries": -1,
        }  # calls are tried until the machine's loss is known
        new_worker = ray.remote(**options, **retries)(_Worker)
        environment = {VARIABLE: os.environ[VARIABLE]} if VARIABLE in os.environ else {}
        workers = {k: new_worker.remote(os.getcwd(), environment) for k, chain in enumerate(chains) if chain}
        left = {k: len(chains[k]) for k in workers}
        waiting = {
            worker.do.remote(work, tuple(arguments)): (k, place)
            for k, worker in workers.items()
            for place, arguments in enumerate(chains[k])
        }
        try:
            while waiting:
                (ended,), _ = ray.wait(list(waiting), num_returns=1)
                k, place = waiting.pop(ended)
                yield k, place, _result(ray, ended)
                left[k] -= 1
                if not left[k]:
                    ray.kill(workers.pop(k))  # its core is for the next home
        finally:
            for worker in workers.values():
                ray.kill(worker)


def _result(ray: ModuleType, ended: Any) -> Any:
    try:
        return ray.get(ended)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.RayError as error:
        raise PersonalVizError(
            f"--on ray: a worker was lost {RESTARTS + 1} times ({type(error).__name__}: {_first_line(error)}); "
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
