"""Independent parts of a study in processes of their own: two at most, so that a shared machine stays usable."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

PROCESSES = 2


@dataclass(frozen=True)
class Job:
    """A function of a module and its arguments, which can be pickled."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def spread(jobs: Sequence[Job], processes: int | None = None) -> list[Any]:
    """Results of the jobs in their order; the same whatever the number of processes."""
    count = min(processes or PROCESSES, os.cpu_count() or 1, len(jobs))
    if count <= 1:
        return [run(job) for job in jobs]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, context) as pool:
        return list(pool.map(run, jobs))


def run(job: Job) -> Any:
    """One job, with one thread."""
    with threadpool_limits(1):
        return job.function(*job.arguments)
