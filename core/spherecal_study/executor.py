"""Independent trials (a kind and settings, plain JSON) in local processes or on a Dask cluster; resumable.

Each result is kept in a file as soon as it is there, and is the same to the bit wherever the trial ran.
"""

import hashlib
import json
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from spherecal import __version__
from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.values import Phrase
from spherecal_files.atomic import write_file_whole
from spherecal_files.json_file import json_bytes

Result = dict[str, Any]
# A trial that takes its worker down this often is at fault itself.
_ATTEMPTS = 3
# Raise it whenever a trial of the same settings gives another result, so that older ones are not taken for it.
_RESULTS = 5
_PARENT_S = 2.0  # between looks at whether the program that started a worker still lives
_SCHEDULER_S = 10.0  # for a Dask scheduler to answer
_PATIENCE_S = 0.1  # between looks at the user's wish to stop


@dataclass(frozen=True)
class Trial:
    """One run: which function does it, and with what."""

    kind: str
    settings: Mapping[str, Any]

    @property
    def key(self) -> str:
        """A name by which its result is found again: of kind, settings and version."""
        text = json.dumps([self.kind, self.settings, __version__, _RESULTS], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


class Workers(Protocol):
    """Where trials run; `results` yields (trial's number, result) in any order, None where it ended every worker."""

    def results(self, trials: Sequence[Trial], context: Context) -> Iterator[tuple[int, Result | None]]:
        """Run all trials; each result with the number of its trial as it comes."""
        ...


def run_trials(
    trials: Sequence[Trial],
    folder: Path,
    workers: Workers,
    context: Context,
    instead: Callable[[Trial], Result] | None = None,
) -> list[Result]:
    """All trials' results in order, those in `folder` and equal ones not run again; `instead` of what cannot run."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(f"{folder}: cannot be written ({reason}).", "Name another place.") from error
    wanted = {trial.key: trial for trial in trials}
    known = {key: result for key, trial in wanted.items() if (result := kept_result(folder, trial)) is not None}
    todo = [trial for key, trial in wanted.items() if key not in known]
    counts = {"number": len(known), "all": len(wanted)}
    context.report("trials", len(known) / max(len(wanted), 1), Phrase("some-known", counts))
    for position, result in workers.results(todo, context):
        trial = todo[position]
        if result is None:
            if instead is None:
                raise InputError(
                    f"Worker processes died {_ATTEMPTS} times without finishing a trial ({trial.kind}).",
                    "Is there enough memory? Try fewer workers.",
                )
            known[trial.key] = instead(trial)
            continue
        document = {"kind": trial.kind, "settings": dict(trial.settings), "result": result}
        write_file_whole(trial_file(folder, trial), json_bytes(document))
        known[trial.key] = result
        counts = {"number": len(known), "all": len(wanted)}
        context.report("trials", len(known) / len(wanted), Phrase("some-of-all", counts))
    return [known[trial.key] for trial in trials]


def trial_file(folder: Path, trial: Trial) -> Path:
    """The file in which the result of a trial is kept."""
    return folder / f"{trial.key}.json"


def kept_result(folder: Path, trial: Trial) -> Result | None:
    """A result from an earlier run, None where there is none (or only a damaged one)."""
    try:
        document = json.loads(trial_file(folder, trial).read_bytes())
    except (OSError, ValueError):
        return None
    same = isinstance(document, dict) and document.get("settings") == json.loads(json.dumps(dict(trial.settings)))
    return document.get("result") if same else None


def run_here(trial: Trial) -> Result:
    """The result of one trial in this process, BLAS with one thread: the last bits depend on their number."""
    from spherecal_study.trials import KINDS

    with threadpool_limits(1):
        return json.loads(json_bytes(KINDS[trial.kind](**trial.settings)))


@dataclass(frozen=True)
class LocalProcesses:
    """Processes on this machine; with a `count` of 0 everything runs in this one."""

    count: int = 2
    run: Callable[[Trial], Result] = run_here

    def results(self, trials: Sequence[Trial], context: Context) -> Iterator[tuple[int, Result | None]]:
        """Run all trials; each result with the number of its trial as it comes. A worker that dies is replaced."""
        if self.count == 0:
            for number, trial in enumerate(trials):
                context.check()
                yield number, self.run(trial)
            return
        left = set(range(len(trials)))
        while left:
            try:
                for number, result in self._in_a_pool(sorted(left), trials, context):
                    left.discard(number)
                    yield number, result
            except BrokenProcessPool:
                # trials begin in their order: one of the first that are left took its worker down
                for number in sorted(left)[: self.count]:
                    yield number, self._alone(number, trials, context)
                    left.discard(number)

    def _alone(self, number: int, trials: Sequence[Trial], context: Context) -> Result | None:
        """The result of one trial in a process that no other trial can take down; None if it dies every time."""
        for _ in range(_ATTEMPTS):
            try:
                return next(iter(self._in_a_pool([number], trials, context)))[1]
            except BrokenProcessPool:
                continue
        return None

    def _in_a_pool(
        self, numbers: Sequence[int], trials: Sequence[Trial], context: Context
    ) -> Iterator[tuple[int, Result | None]]:
        """Results of some trials as they come; BrokenProcessPool once a worker dies."""
        # spawned, not forked: no locks of other threads are inherited, and all systems behave alike
        method = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(min(self.count, len(numbers)), mp_context=method, initializer=_begin_worker)
        finished = False
        try:
            yield from _follow({pool.submit(self.run, trials[number]): number for number in numbers}, context)
            finished = True
        finally:
            # who stops does not wait for trials of minutes: results are written whole, and the pool is at its end
            for process in [] if finished else list((pool._processes or {}).values()):
                process.terminate()
            pool.shutdown(wait=True, cancel_futures=True)


def _begin_worker() -> None:
    """One thread; and no work for a program that was killed (on Windows the parent's number stays)."""
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_PARENT_S)
    os._exit(1)


def _follow(
    futures: dict[Future[Result], int], context: Context, lost: tuple[type[BaseException], ...] = ()
) -> Iterator[tuple[int, Result | None]]:
    """Results as they come, None for an error that is `lost`, looking up whether the user wants to stop."""
    pending = set(futures)
    while pending:
        context.check()
        done, pending = wait(pending, timeout=_PATIENCE_S, return_when=FIRST_COMPLETED)
        for future in done:
            try:
                result = future.result()
            except lost:
                result = None
            yield futures[future], result


@dataclass(frozen=True)
class DaskCluster:
    """An existing Dask cluster by the address of its scheduler; its workers need this program installed."""

    address: str
    run: Callable[[Trial], Result] = run_here

    def results(self, trials: Sequence[Trial], context: Context) -> Iterator[tuple[int, Result | None]]:
        """Run all trials; each result with its trial's number as it comes. A lost worker's trials are repeated."""
        client = self._client()
        from distributed import KilledWorker

        try:
            pool = client.get_executor(pure=False, retries=_ATTEMPTS)
            yield from _follow(
                {pool.submit(self.run, one): i for i, one in enumerate(trials)}, context, (KilledWorker,)
            )
        finally:
            client.close()

    def _client(self):
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                "A cluster needs the package dask, which is not installed.", "pip install 'spherecal[distributed]'"
            ) from None
        try:
            return Client(self.address, timeout=_SCHEDULER_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"No Dask scheduler answers at {self.address}: {error}.",
                "Start one: dask scheduler; dask worker ADDRESS.",
            ) from error


def workers_for(count: int, cluster: str | None) -> Workers:
    """An existing cluster where an address is given, else local processes."""
    return DaskCluster(cluster) if cluster else LocalProcesses(count)
