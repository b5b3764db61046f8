"""Workers on this machine or on Ray: one result per episode, in an order that does not depend on them."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Container, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Generic, TypeVar

from sim.errors import PersonalVizError
from sim.types import EpisodeKey

from .on_ray import RayCluster, done_on_ray


@dataclass(frozen=True, slots=True)
class SceneJob:
    """Episodes of one scene, to be done in order; subclasses add the settings of their work."""

    dataset_root: Path
    scene: str
    keys: tuple[EpisodeKey, ...]
    evidence: tuple[Path, ...] = field(default=(), kw_only=True)
    """Folders of the dataset's evidence."""


Workers = int | RayCluster
"""Number of worker processes on this machine, where 1 = this process does the work; or a Ray cluster."""
Job = TypeVar("Job", bound=SceneJob)
Given = TypeVar("Given")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class _Batch(Generic[Result]):
    results: tuple[Result, ...]
    error: PersonalVizError | None
    """The error that ended the batch early."""


def results(
    open_scene: Callable[[Job], Callable[[EpisodeKey], Result]], jobs: Sequence[Job], *, processes: Workers, batch: int
) -> Iterator[Result]:
    """Yields the result of each episode of each job, in order; before an error, all results finished earlier.

    Args:
        open_scene: A module-level function that opens a job's scene and returns a function for one of its episodes.
        jobs: The work; jobs are small, since each is sent to a process. A scene without episodes is not opened.
        processes: The workers.
        batch: Most episodes that a process of this machine does before it returns them. Its loss costs at most one
            batch; but processes share a scene batch by batch, and each of them opens it. On Ray each scene has one
            worker, which returns each episode, so that its loss costs no finished one.

    Raises:
        PersonalVizError: An episode could not be done, or a worker process was ended from outside.
    """
    jobs = [job for job in jobs if job.keys]
    if processes == 1:
        for job in jobs:
            yield from map(open_scene(job), job.keys)
        return
    each = 1 if isinstance(processes, RayCluster) else batch
    calls = [
        [(open_scene, replace(job, keys=()), job.keys[first : first + each]) for first in range(0, len(job.keys), each)]
        for job in jobs
    ]
    with closing(_batches(calls, processes, [job.scene for job in jobs])) as batches:
        for done in batches:
            yield from done.results
            if done.error is not None:
                raise done.error


def _batches(calls: Sequence[Sequence[tuple]], workers: Workers, scenes: Sequence[str]) -> Generator[_Batch]:
    """The batches of each scene's calls of `_do_batch`, in order."""
    if isinstance(workers, RayCluster):
        ended: dict[tuple[int, int], _Batch] = {}
        order = iter([(k, place) for k, chain in enumerate(calls) for place in range(len(chain))])
        due = next(order, None)
        for k, place, done in done_on_ray(workers, _do_batch, calls, names=scenes):
            ended[k, place] = done
            while due in ended:
                yield ended.pop(due)
                due = next(order, None)
        return
    with worker_pool(workers, kept="finished episodes are kept") as pool:
        for future in [pool.submit(_do_batch, *call) for chain in calls for call in chain]:
            yield future.result()


@contextmanager
def worker_pool(processes: int, *, kept: str = "") -> Iterator[ProcessPoolExecutor]:
    """Fresh processes for a block, which end with this one; work that has not begun at the block's end is dropped.

    Args:
        processes: Number of processes.
        kept: A clause of the error about results that a second call need not make again; empty = none.

    Raises:
        PersonalVizError: A worker process was ended from outside.
    """
    # spawn: forked children of a process that has loaded numba, torch or Open3D can deadlock in their thread pools
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=end_with_parent)
    try:
        yield pool
    except BrokenProcessPool:
        raise PersonalVizError(
            f"--jobs {processes}: a worker process was ended from outside; expected all to finish. Memory may have run "
            f"out: run again with fewer --jobs{', ' if kept else ''}{kept}."
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def run_jobs(
    work: Callable[[Given], Result],
    jobs: Sequence[Given],
    *,
    processes: Workers,
    kept: str = "",
    name_of: Callable[[Given], str] = str,
) -> Iterator[Result]:
    """Yields the result of `work` for each job, in the order in which jobs end.

    Args:
        work: A module-level function.
        jobs: Its arguments.
        processes: The workers.
        kept: As in `worker_pool`.
        name_of: What errors of Ray call a job.
    """
    if isinstance(processes, RayCluster):
        for _, _, done in done_on_ray(
            processes, work, [[(job,)] for job in jobs], names=[name_of(job) for job in jobs]
        ):
            yield done
        return
    if processes == 1 or len(jobs) == 1:
        yield from map(work, jobs)
        return
    with worker_pool(min(processes, len(jobs)), kept=kept) as pool:
        for future in as_completed([pool.submit(work, job) for job in jobs]):
            yield future.result()


def without(jobs: Sequence[Job], done: Container[EpisodeKey]) -> list[Job]:
    """The jobs with the episodes that are not yet done."""
    return [replace(job, keys=tuple(key for key in job.keys if key not in done)) for job in jobs]


def end_with_parent() -> None:
    """Ends a worker process when the program is killed; otherwise it would wait for work forever."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "not in a worker process"

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _do_batch(
    open_scene: Callable[[Job], Callable[[EpisodeKey], Result]], job: Job, keys: Sequence[EpisodeKey]
) -> _Batch[Result]:
    found: list[Result] = []
    try:
        do_episode = _open_cached(open_scene, job)
        for key in keys:
            found.append(do_episode(key))
    except PersonalVizError as error:
        return _Batch(tuple(found), error)
    return _Batch(tuple(found), None)


@lru_cache(maxsize=1)
def _open_cached(
    open_scene: Callable[[Job], Callable[[EpisodeKey], Result]], job: Job
) -> Callable[[EpisodeKey], Result]:
    """The opened scene; the last one of this process stays open, because its next batch often needs the same one."""
    return open_scene(job)
