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
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any

import numpy as np
from msgspec import Struct

from agent.parent import signal_at_death_of
from channels.randomness import stable_key
from emulator.errors import RunFailed
from emulator.interrupts import held

MOST_SAMPLES = 10**10
MOST_JOBS = 256

Partial = Any
"""What one chunk yields: anything that can be pickled."""


def _nothing() -> None:
    """What most studies do before they start."""


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
    prepare: Callable[[], object] = _nothing
    """Called before workers start: what it compiles, none of them needs to."""
    chance: str | None = None
    """Another study's name, to draw what that draws: samples can then be compared one by one."""


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

    A chunk's generator does not depend on the parameters, so that studies with one seed share their
    chance: what they differ in is told apart the better, but their errors are not independent.
    """
    study.check(parameters)
    samples = study.samples if samples is None else samples
    if not 1 <= samples <= MOST_SAMPLES:
        raise ValueError(f"samples: a study takes at least 1 and at most {MOST_SAMPLES}, not {samples}")
    size = study.chunk(parameters)
    chunks = -(-samples // size)
    tasks = ((study, parameters, seed, i, min(size, samples - i * size)) for i in range(chunks))
    study.prepare()
    partials: list[Partial] = []
    with workers or Workers(jobs) as crew:
        for partial in crew.simulate(tasks, chunks, study.max_jobs):
            partials.append(partial)
            on_progress(min(samples, len(partials) * size))
    return study.summarise(parameters, partials)


class Workers:
    """Processes that share the chunks of studies; none are started for what one can do as well.

    A context manager, which may be entered again while it is entered; the processes end with the
    outermost. `jobs`: how many (default: one per processor).
    """

    def __init__(self, jobs: int | None = None) -> None:
        self._jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
        if not 1 <= self._jobs <= MOST_JOBS:
            raise ValueError(f"jobs: 1 to {MOST_JOBS} processes can work, not {jobs}")
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

    def simulate(self, tasks: Iterable[Task], count: int, max_jobs: int | None) -> Iterator[Partial]:
        """The results of `count` tasks, in their order, as they become ready; `max_jobs` as in `Study`."""
        if min(self._jobs, count, max_jobs or self._jobs) <= 1:
            return map(_simulate, tasks)
        if self._pool is None:
            self._others = set(multiprocessing.active_children())
            # Spawned, not forked: the progress bar has a thread, and threads do not survive a fork.
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._jobs, context, _end_with_parent, (os.getpid(),))
        return _in_order(self._pool, tasks, 2 * self._jobs)


def generator(study: str, seed: int, chunk: int) -> np.random.Generator:
    """The generator of one chunk of a study."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, stable_key(study), chunk])))


def one_each(_parameters: object) -> int:
    """Samples per chunk, for studies whose samples are long, or are compared one by one."""
    return 1


def mean_and_error(values: Sequence[float]) -> tuple[float, float | None]:
    """Mean of independent values, and its standard error (None below two of them)."""
    count = len(values)
    mean = math.fsum(values) / count
    if count < 2:
        return mean, None
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    return mean, math.sqrt(variance / count)


def spread(values: Sequence[float]) -> dict[str, float | None]:
    """`mean`, `sd` and `se` of independent values; the latter two None below two of them."""
    mean, error = mean_and_error(values)
    return {"mean": mean, "sd": None if error is None else error * math.sqrt(len(values)), "se": error}


def described(values: Iterable[float | None]) -> dict[str, float | None]:
    """`mean` and `se` of those values that are there, for a result; None where there are too few."""
    there = [value for value in values if value is not None]
    mean, error = mean_and_error(there) if there else (None, None)
    return {"mean": mean, "se": error}


def error_of_sums(samples: int, total: int, square: int, scale: int = 1) -> float | None:
    """Standard error of the mean of values x / scale, from the sums of x and of its square; None below two.

    In whole numbers, so that nothing is lost where values hardly differ.
    """
    if samples < 2:
        return None
    return math.sqrt((samples * square - total * total) / (samples - 1)) / samples / scale


Task = tuple[Study, Struct, int, int, int]


def _simulate(task: Task) -> Partial:
    study, parameters, seed, number, size = task
    return study.simulate(parameters, generator(study.chance or study.name, seed, number), size)


def _in_order(pool: ProcessPoolExecutor, tasks: Iterable[Task], ahead: int) -> Iterator[Partial]:
    """Results in the order of the tasks, of which so many are handed out ahead of what is taken."""
    rest = iter(tasks)
    waiting: deque[Future[Partial]] = deque()
    try:
        waiting.extend(_submit(pool, task) for task in islice(rest, ahead))
        while waiting:
            yield waiting.popleft().result()
            waiting.extend(_submit(pool, task) for task in islice(rest, 1))
    except BrokenProcessPool:
        sentence = "a process that worked on the study was killed (out of memory?); try fewer --jobs"
        raise RunFailed(sentence) from None


def _submit(pool: ProcessPoolExecutor, task: Task) -> Future[Partial]:
    """Hand out a task, which may start a worker.

    A signal that cut this short would leave a worker half told what to do, which it would answer with
    a traceback; so the signal waits. So would a worker that hears Ctrl-C while it still imports, hence
    it is born with that signal blocked.
    """
    with held():
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return pool.submit(_simulate, task)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _end_with_parent(parent: int) -> None:
    """Interrupts are the parent's to handle; but no worker outlives it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal_at_death_of(parent, signal.SIGKILL)
