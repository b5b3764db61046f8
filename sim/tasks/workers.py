"""Worker processes: one result per episode, in an order that does not depend on the number of processes."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Container, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Generic, TypeVar

from sim.errors import PersonalVizError
from sim.types import EpisodeKey


@dataclass(frozen=True, slots=True)
class SceneJob:
    """Episodes of one scene, to be done in order; subclasses add the settings of their work."""

    dataset_root: Path
    scene: str
    keys: tuple[EpisodeKey, ...]
    evidence: tuple[Path, ...] = field(default=(), kw_only=True)
    """Folders of the dataset's evidence."""


Job = TypeVar("Job", bound=SceneJob)
Given = TypeVar("Given")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class _Batch(Generic[Result]):
    results: tuple[Result, ...]
    error: PersonalVizError | None
    """The error that ended the batch early."""


def results(
    open_scene: Callable[[Job], Callable[[EpisodeKey], Result]], jobs: Sequence[Job], *, processes: int, batch: int
) -> Iterator[Result]:
    """Yields the result of each episode of each job, in order; before an error, all results finished earlier.

    Args:
        open_scene: A module-level function that opens a job's scene and returns a function for one of its episodes.
        jobs: The work; jobs are small, since each is sent to a process. A scene without episodes is not opened.
        processes: Number of worker processes; 1 = this process does the work.
        batch: Most episodes that a worker process does before it returns them. A kill loses at most one batch per
            process; but processes share a scene batch by batch, and each of them opens it.

    Raises:
        PersonalVizError: An episode could not be done, or a worker process was ended from outside.
    """
    jobs = [job for job in jobs if job.keys]
    if processes <= 1:
        for job in jobs:
            yield from map(open_scene(job), job.keys)
        return
    with worker_pool(processes, kept="finished episodes are kept") as pool:
        batches = [
            pool.submit(_do_batch, open_scene, replace(job, keys=()), job.keys[first : first + batch])
            for job in jobs
            for first in range(0, len(job.keys), batch)
        ]
        for future in batches:
            done = future.result()
            yield from done.results
            if done.error is not None:
                raise done.error


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
    work: Callable[[Given], Result], jobs: Sequence[Given], *, processes: int, kept: str = ""
) -> Iterator[Result]:
    """Yields the result of `work` for each job, in the order in which jobs end.

    Args:
        work: A module-level function.
        jobs: Its arguments.
        processes: Number of worker processes; 1 = this process does the work.
        kept: As in `worker_pool`.
    """
    if processes <= 1 or len(jobs) == 1:
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
