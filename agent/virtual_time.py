"""An asyncio event loop whose clock moves only when somebody grants it time.

Ordinary asyncio code (`sleep`, `timeout`, queues, task groups, ...) runs on it unchanged. Whoever drives
the loop repeats three calls::

    loop.advance_to(now_ns)          # grant: virtual time is now this instant
    loop.run_until_idle()            # everything that can happen at this instant happens
    wake_ns = loop.next_deadline()   # the loop asks to be granted this instant next

The rules:

====================  ===================================================================================
time                  integer nanoseconds outside, `time()` is that integer as seconds; frozen while running
callbacks             run in exactly the order of `asyncio.BaseEventLoop._run_once`, pass by pass, with the
                      same heap of timers, so that even ties between equal deadlines come out alike
a timer is due        when it lies less than 1 ns after now (asyncio's clock resolution); after
                      `run_until_idle` the next deadline is therefore always later than now
cancelled timers      never show as a deadline
deadlines after       11.6 days (`MAX_TIME_NS`), infinity included, are never reached and not reported
executors, to_thread  the loop is not idle until the work is done, and virtual time stands still meanwhile;
                      results are delivered in order of submission, one by one, when nothing else can run
cancelled awaiters    of such work lose its result; the work itself still runs to its end and is waited for
file descriptors      are polled without blocking and never keep the loop from being idle
tasks                 hash by creation number, so that sets of tasks (a failing `TaskGroup` cancels in set
                      order, `asyncio.wait` returns sets) have the same order in every run
exceptions            of callbacks go to the exception handler; SystemExit and KeyboardInterrupt propagate
====================  ===================================================================================

When it can be wrong:

- Code that waits by spinning (`while loop.time() < t: await asyncio.sleep(0)`) waits for ever, since time
  stands still until it yields; so does spinning until a thread is done, and repeating a sleep of less than
  1 ns. `run_until_idle` gives up after `rounds_limit` passes at one instant.
- Code that reads the wall clock (`time.monotonic`, `time.sleep`) sees wall time, which is unrelated.
- A timeout around work in a thread cannot fire while the thread works. A thread that waits for something
  that happens only later in virtual time, or only after the result of work submitted after its own has
  been delivered, is a deadlock: `run_until_idle` blocks.
- `call_soon_threadsafe` (`run_coroutine_threadsafe`) from a thread takes effect whenever the thread gets
  there: with two threads at work, or from a thread that this loop did not start, the order is a race of
  wall time. Sockets, pipes and subprocesses are the same; signal handlers are refused.
- The order of a set of futures or coroutines is that of memory addresses (`asyncio.as_completed` given
  coroutines, the order in which `shutdown_asyncgens` closes generators). Pass tasks, close generators.
- What the garbage collector does (an abandoned asynchronous generator in a reference cycle) happens when
  the collector runs. Use `contextlib.aclosing`.
"""

from __future__ import annotations

import asyncio
import collections
import concurrent.futures
import heapq
import selectors
import sys
import threading
from asyncio.events import _get_running_loop, _set_running_loop
from collections.abc import Callable
from contextvars import Context, copy_context
from itertools import repeat
from typing import Any, NoReturn, TypeVar, TypeVarTuple, Unpack

from agent.numbered_tasks import numbered_tasks
from channels.units import MAX_TIME_NS, NS_PER_S, to_s

_T = TypeVar("_T")
_Ts = TypeVarTuple("_Ts")

_RESOLUTION_S = 1e-9
_LAST_S = to_s(MAX_TIME_NS)

# asyncio's own numbers (asyncio.base_events): with other ones the heap of timers would be rebuilt at
# other moments, and ties between equal deadlines could come out in another order.
_REBUILD_FROM_TIMERS = 100
_REBUILD_FROM_CANCELLED = 0.5

# asyncio's default depends on the CPUs of the machine, and with it which work waits for which.
_DEFAULT_WORKERS = 32

_new: Any = object.__new__


class _Timer(asyncio.TimerHandle):
    """asyncio's, with a `cancel` that does in one call what asyncio does in four: `sleep` always cancels."""

    __slots__ = ()

    def cancel(self) -> None:
        timer: Any = self
        if not timer._cancelled:
            timer._cancelled = True
            if timer._scheduled:
                timer._loop._timer_cancelled_count += 1
            timer._callback = timer._args = None


class _CountingSelector(selectors.DefaultSelector):
    """A selector that knows how many descriptors it watches, for a test that costs next to nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.watched = 0

    def register(self, *args: Any, **options: Any) -> selectors.SelectorKey:
        key = super().register(*args, **options)
        self.watched += 1
        return key

    def unregister(self, *args: Any, **options: Any) -> selectors.SelectorKey:
        key = super().unregister(*args, **options)
        self.watched -= 1
        return key


class GrantedTimeLoop(asyncio.SelectorEventLoop):
    """The event loop of a robot in virtual time; see the module for its rules.

    `rounds_limit` bounds the passes over ready callbacks at one instant (see `run_until_idle`).

    It reads what asyncio keeps private: `_ready`, `_scheduled` and `_timer_cancelled_count` (running the
    queues here, in one small loop, costs a third of `_run_once` with a selector that does nothing),
    `_thread_id` and the asyncgen hooks (set as `run_forever` sets them), `_process_events` and
    `_write_to_self` (polling), `_default_executor`. All are the same from Python 3.11 to 3.13.
    """

    rounds_limit = 1_000_000

    now_ns: int
    """The granted instant in nanoseconds; only `advance_to` changes it. No property: it is read often."""

    _ready: collections.deque[Any]
    _scheduled: list[Any]
    _timer_cancelled_count: int
    _thread_id: int | None
    _clock_resolution: float
    _closed: bool = True  # until it is open: a loop that was refused its start has nothing to close
    _debug: bool
    _selector: _CountingSelector
    _default_executor: concurrent.futures.Executor | None
    _executor_shutdown_called: bool
    _asyncgen_firstiter_hook: Any
    _asyncgen_finalizer_hook: Any
    _check_closed: Callable[[], None]
    _check_running: Callable[[], None]
    _check_callback: Callable[[object, str], None]
    _check_default_executor: Callable[[], None]
    _process_events: Callable[[object], None]
    _write_to_self: Callable[[], None]
    _set_coroutine_origin_tracking: Callable[[bool], None]

    def __init__(self, now_ns: int = 0) -> None:
        """Start the loop's clock at `now_ns` (any integer up to `MAX_TIME_NS` in size, else ValueError)."""
        if not -MAX_TIME_NS <= now_ns <= MAX_TIME_NS:
            raise ValueError(f"virtual time {now_ns} ns is outside +-{MAX_TIME_NS} ns")
        self._set_now(now_ns)
        self._threads: collections.deque[tuple[concurrent.futures.Future[Any], asyncio.Future[Any]]] = (
            collections.deque()
        )
        super().__init__(_CountingSelector())
        self._selector.watched = 0  # all that is registered yet is the loop's own pipe for threads
        self._clock_resolution = _RESOLUTION_S
        self.set_task_factory(numbered_tasks())

    # ---- granted time

    def time(self) -> float:
        """The granted instant in seconds, as asyncio reads it."""
        return self._now_s

    def advance_to(self, now_ns: int) -> None:
        """Grant time up to `now_ns`; nothing runs yet.

        Raises ValueError when that is earlier than now, or later than `MAX_TIME_NS`.
        """
        if not self.now_ns <= now_ns <= MAX_TIME_NS:
            raise ValueError(
                f"virtual time is {self.now_ns} ns and cannot go to {now_ns} ns: "
                f"it never goes back, and ends at {MAX_TIME_NS} ns"
            )
        self._set_now(now_ns)

    def _set_now(self, now_ns: int) -> None:
        self.now_ns = now_ns
        self._now_s = now_s = now_ns / NS_PER_S
        self._due_before_s = now_s + _RESOLUTION_S

    def next_deadline(self) -> int | None:
        """The instant in nanoseconds of the earliest live timer, None when there is none.

        After `run_until_idle` it is later than `now_ns`, and granting it makes that timer due.
        """
        if self._timer_cancelled_count:
            self._drop_cancelled()
        if not self._scheduled:
            return None
        when_s: float = self._scheduled[0]._when
        return round(when_s * NS_PER_S) if when_s <= _LAST_S else None

    # ---- running

    def run_until_idle(self) -> None:
        """Run all callbacks that are ready, timers that are due and threads to their end; never sleeps.

        Raises RuntimeError when the loop is closed, when a loop is running in this thread already, and
        when `rounds_limit` passes at this one instant did not bring it to rest. SystemExit and
        KeyboardInterrupt in a callback propagate; the loop can then be run again and goes on.
        """
        if self._closed or _get_running_loop() is not None:
            self._check_closed()
            self._check_running()
        if self._debug:
            self._set_coroutine_origin_tracking(True)
        hooks = sys.get_asyncgen_hooks()
        sys.set_asyncgen_hooks(self._asyncgen_firstiter_hook, self._asyncgen_finalizer_hook)
        self._thread_id = threading.get_ident()
        _set_running_loop(self)
        try:
            self._run_rounds()
        finally:
            _set_running_loop(None)
            self._thread_id = None
            sys.set_asyncgen_hooks(*hooks)
            if self._debug:
                self._set_coroutine_origin_tracking(False)

    def _run_rounds(self) -> None:
        # This is BaseEventLoop._run_once, again and again: one round is one of its passes. Each step of it
        # is kept, in its place, since the place decides the order of events.
        ready = self._ready
        popleft = ready.popleft
        selector = self._selector
        due_before_s = self._due_before_s
        for _ in repeat(None, self.rounds_limit):
            if self._timer_cancelled_count:
                self._drop_cancelled()
            if selector.watched:
                self._poll(0)
            timers = self._scheduled
            while timers and timers[0]._when < due_before_s:
                handle = heapq.heappop(timers)
                handle._scheduled = False
                ready.append(handle)
            todo = len(ready)
            if not todo:
                if not self._threads:
                    return
                self._await_thread()
            # What these append belongs to the next round, in front of the timers that are due then.
            while todo:
                todo -= 1
                handle = popleft()
                if not handle._cancelled:
                    try:
                        handle._context.run(handle._callback, *handle._args)
                    except (SystemExit, KeyboardInterrupt):
                        raise
                    except BaseException as error:
                        self._report(handle, error)
            handle = None  # or what it holds outlives its round, and is missed later than on asyncio's loop
        raise RuntimeError(
            f"not idle after {self.rounds_limit} rounds at {self.now_ns} ns of virtual time: does a task "
            "repeat asyncio.sleep(0) until something happens? Time stands still until it waits"
        )

    def _report(self, handle: Any, error: BaseException) -> None:
        context = {"message": f"Exception in callback {handle!r}", "exception": error, "handle": handle}
        if handle._source_traceback:
            context["source_traceback"] = handle._source_traceback
        self.call_exception_handler(context)

    def _drop_cancelled(self) -> None:
        timers = self._scheduled
        total = len(timers)
        if total > _REBUILD_FROM_TIMERS and self._timer_cancelled_count / total > _REBUILD_FROM_CANCELLED:
            for timer in timers:
                timer._scheduled = not timer._cancelled
            self._scheduled = timers = [timer for timer in timers if not timer._cancelled]
            heapq.heapify(timers)
            self._timer_cancelled_count = 0
            return
        while timers and timers[0]._cancelled:
            self._timer_cancelled_count -= 1
            heapq.heappop(timers)._scheduled = False

    def _poll(self, timeout_s: float | None) -> None:
        self._process_events(self._selector.select(timeout_s))

    def _await_thread(self) -> None:
        """Deliver the result of the oldest work in threads, or wait until it or anything else happens."""
        source, future = self._threads[0]
        if source.done():
            self._threads.popleft()
            self.call_soon(_settle, source, future)
        else:
            self._poll(None)

    # ---- scheduling: asyncio's own, without its calls of calls; debug mode keeps asyncio's

    def call_soon(
        self, callback: Callable[[Unpack[_Ts]], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """Append a callback to those that are ready, as asyncio does."""
        if self._debug or self._closed:
            return _hide_caller(super().call_soon(callback, *args, context=context))
        handle: Any = _new(asyncio.Handle)
        handle._callback = callback
        handle._args = args
        handle._context = copy_context() if context is None else context
        handle._loop = self
        handle._cancelled = False
        handle._repr = handle._source_traceback = None
        self._ready.append(handle)
        return handle  # type: ignore[no-any-return]

    def call_later(
        self,
        delay: float,
        callback: Callable[[Unpack[_Ts]], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Schedule a callback `delay` seconds from now; TypeError and ValueError as `call_at`."""
        if type(delay) is not float or delay != delay or self._debug or self._closed:
            when = self._now_s + _as_seconds(delay)
            return _hide_caller(self.call_at(when, callback, *args, context=context))
        return self._schedule(self._now_s + delay, callback, args, context)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[_Ts]], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Schedule a callback at an instant of `time()`.

        Raises TypeError when that is not a number, ValueError when it is NaN (which no heap can order).
        """
        when = _as_seconds(when)
        if self._debug or self._closed:
            return _hide_caller(super().call_at(when, callback, *args, context=context))
        return self._schedule(when, callback, args, context)

    def _schedule(
        self, when_s: float, callback: Callable[..., object], args: object, context: Context | None
    ) -> asyncio.TimerHandle:
        timer: Any = _new(_Timer)
        timer._when = when_s
        timer._scheduled = True
        timer._callback = callback
        timer._args = args
        timer._context = copy_context() if context is None else context
        timer._loop = self
        timer._cancelled = False
        timer._repr = timer._source_traceback = None
        heapq.heappush(self._scheduled, timer)
        return timer  # type: ignore[no-any-return]

    # ---- threads

    def run_in_executor(
        self, executor: concurrent.futures.Executor | None, func: Callable[[Unpack[_Ts]], _T], *args: *_Ts
    ) -> asyncio.Future[_T]:
        """Run `func(*args)` in an executor, by default in one of 32 threads.

        The loop is not idle until it is done. Cancelling the future drops the result, not the work: asyncio
        would withdraw work that no thread has begun yet, and whether one has is a matter of wall time.
        """
        self._check_closed()
        if self._debug:
            self._check_callback(func, "run_in_executor")
        if executor is None:
            self._check_default_executor()
            executor = self._default_executor
            if executor is None:
                executor = concurrent.futures.ThreadPoolExecutor(
                    _DEFAULT_WORKERS, thread_name_prefix="asyncio"
                )
                self._default_executor = executor
        source = executor.submit(func, *args)
        future: asyncio.Future[_T] = self.create_future()
        self._threads.append((source, future))
        source.add_done_callback(self._on_thread_done)
        return future

    def _on_thread_done(self, _source: object) -> None:
        self._write_to_self()

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Wait until the default executor's work is done; no `timeout` could pass meanwhile."""
        self._executor_shutdown_called = True
        executor = self._default_executor
        if executor is None:
            return
        with concurrent.futures.ThreadPoolExecutor(1, thread_name_prefix="asyncio") as closer:
            await self.run_in_executor(closer, executor.shutdown)

    # ---- ways to run that would have to move time by themselves

    def run_forever(self) -> NoReturn:
        """Refuse (RuntimeError): time must be granted."""
        raise RuntimeError(
            "a GrantedTimeLoop does not move time by itself: create a task, then repeat advance_to(), "
            "run_until_idle() and next_deadline()"
        )

    def run_until_complete(self, future: object) -> NoReturn:
        """Refuse (RuntimeError): time must be granted."""
        if asyncio.iscoroutine(future):
            future.close()
        self.run_forever()

    def stop(self) -> NoReturn:
        """Refuse (RuntimeError): the loop runs until it is idle, and then no further than it is granted."""
        raise RuntimeError("a GrantedTimeLoop cannot be stopped from within: end the tasks instead")

    def add_signal_handler(self, sig: int, callback: Callable[..., object], *args: object) -> NoReturn:
        """Refuse (NotImplementedError, as asyncio does on systems without signals)."""
        raise NotImplementedError("signals come in wall time: a GrantedTimeLoop does not handle them")

    def close(self) -> None:
        """Close the loop (RuntimeError while it runs); what has not run or been delivered is dropped."""
        super().close()
        self._threads.clear()


_AnyHandle = TypeVar("_AnyHandle", bound=asyncio.Handle)


def _hide_caller(handle: _AnyHandle) -> _AnyHandle:
    """Drop this module's frame from where, in debug mode, a handle says it was created."""
    trace: list[Any] | None = handle._source_traceback  # type: ignore[attr-defined]
    if trace:
        del trace[-1]
    return handle


def _as_seconds(number: Any) -> float:
    """A Python float of any real number: sums with numpy's float32 would round to microseconds."""
    if not hasattr(number, "__float__"):
        raise TypeError(f"a number of seconds is needed, not {number!r}")
    seconds = float(number)
    if seconds != seconds:
        raise ValueError("a timer at NaN seconds would never be due")
    return seconds


def _settle(source: concurrent.futures.Future[Any], future: asyncio.Future[Any]) -> None:
    """Copy the outcome of finished work to the future that stands for it, unless that was cancelled."""
    if future.done():
        return
    if source.cancelled():
        future.cancel()
        return
    error = source.exception()
    if error is None:
        future.set_result(source.result())
    elif isinstance(error, concurrent.futures.CancelledError):
        # Raised in the thread by run_coroutine_threadsafe(...).result(); here it has asyncio's type.
        future.set_exception(asyncio.CancelledError(*error.args))
    else:
        future.set_exception(error)
