"""Studies: large samples of one experiment by vectorised Monte Carlo, equal for a seed whatever `jobs`.

A study is cut into chunks whose size depends on its parameters alone. Chunk i draws from a generator of
its own, seeded from (seed, study, i), and the chunks' results are put together in their order: how many
processes share the work, and which is done first, changes nothing.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import numpy as np
from msgspec import Struct

from channels.randomness import stable_key
from emulator.errors import RunFailed

Partial = Any
"""What one chunk yields: anything that can be pickled."""


class Study(Struct, frozen=True):
    """One experiment that can be repeated as often as one likes. All functions live in modules (pickled)."""

    name: str
    title: str
    parameters: type[Struct]
    """A struct with a default for every field; its `Meta` gives ranges and descriptions."""
    samples: int
    """How many, unless the user says."""
    unit: str
    """What one sample is, in the plural: runs, worlds."""
    chunk: Callable[[Any], int]
    """Samples per chunk; a function of the parameters and of nothing else."""
    simulate: Callable[[Any, np.random.Generator, int], Partial]
    """One chunk of so many samples, all its randomness from the generator."""
    summarise: Callable[[Any, list[Partial]], dict[str, Any]]
    """The result, which JSON has a form for, of all chunks in their order."""
    check: Callable[[Any], None]
    """Raises ValueError, "key: what is wrong and what helps", for parameters that do not go together."""
    max_jobs: int | None = None
    """1: chunks keep all processors busy by themselves."""


def run_study(
    study: Study,
    parameters: Struct,
    *,
    samples: int | None = None,
    seed: int = 1,
    jobs: int | None = None,
    workers: Workers | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
) -> dict[str, Any]:
    """The result of `samples` samples; `on_progress` is told how many are done.

    `jobs` processes share the work (default: one per processor), or those of `workers`, which can do
    several studies one after the other. Raises ValueError for parameters that do not go together,
    RunFailed where a process dies.
    """
    study.check(parameters)
    samples = study.samples if samples is None else samples
    if samples < 1:
        raise ValueError(f"samples: a study takes at least 1, not {samples}")
    sizes = _chunks(samples, study.chunk(parameters))
    tasks = [(study, parameters, seed, number, size) for number, size in enumerate(sizes)]
    partials: list[Partial] = []
    done = 0
    with workers or Workers(jobs) as crew:
        for size, partial in zip(sizes, crew.simulate(tasks, study.max_jobs), strict=True):
            partials.append(partial)
            done += size
            on_progress(done)
    return study.summarise(parameters, partials)


class Workers:
    """Processes that share the chunks of studies; none are started for what one can do as well.

    A context manager, which may be entered again while it is entered; the processes end with the
    outermost. `jobs`: how many (default: one per processor).
    """

    def __init__(self, jobs: int | None = None) -> None:
        self._jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
        if self._jobs < 1:
            raise ValueError(f"jobs: at least 1 process has to work, not {jobs}")
        self._pool: ProcessPoolExecutor | None = None
        self._others: set[Any] = set()
        self._entered = 0

    def __enter__(self) -> Workers:
        self._entered += 1
        return self

    def __exit__(self, failure: type[BaseException] | None, *_: object) -> None:
        self._entered -= 1
        if self._entered or self._pool is None:
            return
        if failure is not None:  # nobody waits for chunks whose results nobody will read
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None

    def simulate(self, tasks: list[Task], max_jobs: int | None) -> Iterator[Partial]:
        """The results of all tasks, in their order, as they become ready; `max_jobs` as in `Study`."""
        if min(self._jobs, len(tasks), max_jobs or self._jobs) <= 1:
            return map(_simulate, tasks)
        if self._pool is None:
            self._others = set(multiprocessing.active_children())
            # Spawned, not forked: the progress bar has a thread, and threads do not survive a fork.
            self._pool = ProcessPoolExecutor(
                self._jobs, multiprocessing.get_context("spawn"), _leave_interrupts_to_the_parent
            )
        return _in_order([self._pool.submit(_simulate, task) for task in tasks])


def generator(study: str, seed: int, chunk: int) -> np.random.Generator:
    """The generator of one chunk of a study."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, stable_key(study), chunk])))


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Mean of independent values, and its standard error (infinite below two of them)."""
    count = len(values)
    mean = math.fsum(values) / count
    if count < 2:
        return mean, math.inf
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    return mean, math.sqrt(variance / count)


Task = tuple[Study, Struct, int, int, int]


def _simulate(task: Task) -> Partial:
    study, parameters, seed, number, size = task
    return study.simulate(parameters, generator(study.name, seed, number), size)


def _chunks(samples: int, most: int) -> list[int]:
    whole, rest = divmod(samples, most)
    return [most] * whole + ([rest] if rest else [])


def _in_order(futures: list[Future[Partial]]) -> Iterator[Partial]:
    futures.reverse()
    while futures:
        try:
            yield futures.pop().result()  # popped, so that what has been handed on is not kept twice
        except BrokenProcessPool:
            sentence = "a process that worked on the study was killed (out of memory?); try fewer --jobs"
            raise RunFailed(sentence) from None


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
