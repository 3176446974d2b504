from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import contextvars
import gc
import math
import socket
import sys
import threading
import time
import warnings
import weakref
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

import numpy as np
import pytest

from agent.numbered_tasks import numbered_tasks
from agent.virtual_time import GrantedTimeLoop

S = 1_000_000_000
Trace = list[tuple[Any, int]]


@pytest.fixture
def loop() -> Iterator[GrantedTimeLoop]:
    loop = GrantedTimeLoop()
    yield loop
    loop.close()


@pytest.fixture
def trace() -> Trace:
    return []


def noter(loop: GrantedTimeLoop, trace: Trace) -> Callable[[Any], None]:
    return lambda what: trace.append((what, loop.now_ns))


def run(loop: GrantedTimeLoop, until_ns: int = 10**15) -> None:
    """Grant every instant the loop asks for."""
    loop.run_until_idle()
    while (deadline_ns := loop.next_deadline()) is not None and deadline_ns <= until_ns:
        assert deadline_ns > loop.now_ns
        loop.advance_to(deadline_ns)
        loop.run_until_idle()


# ---- granted time


def test_a_new_loop_stands_at_its_start_and_wants_nothing() -> None:
    loop = GrantedTimeLoop(1_500_000_000)
    assert (loop.now_ns, loop.time(), loop.next_deadline()) == (1_500_000_000, 1.5, None)
    loop.run_until_idle()
    assert loop.next_deadline() is None
    loop.close()


def test_sleep_wakes_at_the_granted_instant_and_not_before(loop: GrantedTimeLoop) -> None:
    task = loop.create_task(asyncio.sleep(0.5, "slept"))
    loop.run_until_idle()
    assert loop.next_deadline() == S // 2
    loop.advance_to(S // 2 - 2)
    loop.run_until_idle()
    assert not task.done()
    assert loop.next_deadline() == S // 2
    loop.advance_to(S // 2)
    loop.run_until_idle()
    assert task.result() == "slept"


def test_advancing_runs_nothing_by_itself(loop: GrantedTimeLoop, trace: Trace) -> None:
    loop.call_later(1, trace.append, ("called", 1))
    loop.advance_to(5 * S)
    assert trace == []
    loop.run_until_idle()
    assert trace == [("called", 1)]


def test_time_stands_still_while_callbacks_run(loop: GrantedTimeLoop) -> None:
    def callback() -> None:
        before_s = loop.time()
        time.sleep(0.002)
        assert loop.time() == before_s
        ran.append(before_s)

    ran: list[float] = []
    loop.call_later(0.5, callback)
    run(loop)
    assert ran == [0.5]


@pytest.mark.parametrize("to_ns", [6, -1, 10**15 + 1])
def test_time_goes_neither_back_nor_past_its_end(to_ns: int) -> None:
    loop = GrantedTimeLoop(7)
    with pytest.raises(ValueError, match="7 ns"):
        loop.advance_to(to_ns)
    loop.advance_to(7)
    assert loop.now_ns == 7
    loop.close()


def test_a_clock_may_start_before_zero_but_not_outside_its_range() -> None:
    loop = GrantedTimeLoop(-S)
    task = loop.create_task(asyncio.sleep(1.25))
    loop.run_until_idle()
    assert loop.next_deadline() == S // 4
    loop.advance_to(S // 4)
    loop.run_until_idle()
    assert task.done()
    loop.close()
    with pytest.raises(ValueError, match="outside"):
        GrantedTimeLoop(10**15 + 1)


def test_decimal_deadlines_are_whole_nanoseconds(loop: GrantedTimeLoop) -> None:
    wakes = []

    async def behaviour() -> None:
        for delay_s in (0.1, 0.2, 0.3, 0.7):
            await asyncio.sleep(delay_s)
            wakes.append((loop.now_ns, loop.time()))

    loop.create_task(behaviour())
    run(loop)
    # 0.1 + 0.2 is 0.30000000000000004 as a float; the grant puts time() right again.
    assert wakes == [(S // 10, 0.1), (3 * S // 10, 0.3), (6 * S // 10, 0.6), (13 * S // 10, 1.3)]


@pytest.mark.parametrize("start_s", [0, 1, 1000, 123_456, 999_998])
@pytest.mark.parametrize("delay_s", [1e-12, 4e-10, 9.99e-10, 1e-9, 1.4e-9, 1.6e-9, 2e-9, 1e-6, 0.1])
def test_every_deadline_is_later_than_now_and_granting_it_is_enough(start_s: int, delay_s: float) -> None:
    for offset_ns in (0, 1, 333_333_333, 999_999_999):
        loop = GrantedTimeLoop(start_s * S + offset_ns)
        task = loop.create_task(asyncio.sleep(delay_s))
        loop.run_until_idle()
        deadline_ns = loop.next_deadline()
        if deadline_ns is not None:
            assert deadline_ns > loop.now_ns
            loop.advance_to(deadline_ns)
            loop.run_until_idle()
        assert task.done()
        assert loop.now_ns - (start_s * S + offset_ns) == pytest.approx(delay_s * S, abs=1.1)
        loop.close()


def test_the_last_instant_can_be_reached_and_later_ones_are_no_deadlines() -> None:
    loop = GrantedTimeLoop(10**15 - S)
    reached = loop.create_task(asyncio.sleep(1))
    never = [loop.create_task(asyncio.sleep(delay_s)) for delay_s in (1.5, 1e300, math.inf)]
    loop.run_until_idle()
    assert loop.next_deadline() == 10**15
    run(loop)
    assert reached.done()
    assert not any(task.done() for task in never)
    assert loop.next_deadline() is None
    for task in never:
        task.cancel()
    loop.run_until_idle()
    loop.close()


def test_cancelled_timers_are_no_deadlines(loop: GrantedTimeLoop) -> None:
    first, second, third = (loop.call_later(delay_s, print) for delay_s in (1, 2, 3))
    second.cancel()
    assert loop.next_deadline() == S
    first.cancel()
    first.cancel()
    assert loop.next_deadline() == 3 * S
    third.cancel()
    assert loop.next_deadline() is None


def test_many_cancelled_timers_are_forgotten(loop: GrantedTimeLoop) -> None:
    handles = [loop.call_later(1 + number, print) for number in range(300)]
    for handle in handles[1:]:
        handle.cancel()
    assert loop.next_deadline() == S
    assert len(loop._scheduled) == 1


def test_a_finished_timeout_leaves_no_deadline(loop: GrantedTimeLoop) -> None:
    async def behaviour() -> None:
        async with asyncio.timeout(5):
            await asyncio.sleep(1)

    loop.create_task(behaviour())
    run(loop)
    assert loop.now_ns == S


def test_delays_of_numpy_types_keep_their_nanoseconds() -> None:
    loop = GrantedTimeLoop(100_300_000_000)
    loop.call_later(np.float32(0.25), print)  # type: ignore[arg-type]
    loop.call_later(np.float64(0.125), print)
    loop.call_later(np.int64(1), print)  # type: ignore[arg-type]
    assert [type(timer._when) for timer in loop._scheduled] == [float] * 3
    assert sorted(round(timer._when * S) for timer in loop._scheduled) == [
        100_425_000_000,
        100_550_000_000,
        101_300_000_000,
    ]
    loop.close()


def test_timers_at_no_time_are_refused(loop: GrantedTimeLoop) -> None:
    for schedule in (loop.call_later, loop.call_at):
        with pytest.raises(ValueError, match="NaN"):
            schedule(math.nan, print)
        for no_number in (None, "1"):
            with pytest.raises(TypeError, match="seconds"):
                schedule(no_number, print)  # type: ignore[arg-type]
    assert loop.next_deadline() is None


# ---- order


def test_callbacks_run_in_order_of_scheduling_and_timers_by_deadline(
    loop: GrantedTimeLoop, trace: Trace
) -> None:
    note = noter(loop, trace)
    loop.call_later(2, note, "late")
    loop.call_at(1, note, "early")
    loop.call_soon(note, "first")
    loop.call_soon(note, "second")
    run(loop)
    assert trace == [("first", 0), ("second", 0), ("early", S), ("late", 2 * S)]


def test_a_timer_due_at_once_runs_behind_what_its_round_made_ready(
    loop: GrantedTimeLoop, trace: Trace
) -> None:
    note = noter(loop, trace)

    def first() -> None:
        loop.call_later(0, note, "timer")
        loop.call_soon(note, "soon")

    def second() -> None:
        loop.call_soon(lambda: (note("soon 2"), loop.call_soon(note, "last")))

    loop.call_soon(first)
    loop.call_soon(second)
    loop.run_until_idle()
    assert [what for what, _ in trace] == ["soon", "soon 2", "timer", "last"]


def test_a_cancelled_callback_does_not_run(loop: GrantedTimeLoop, trace: Trace) -> None:
    loop.call_soon(noter(loop, trace), "no").cancel()
    timer = loop.call_later(1, noter(loop, trace), "no")
    loop.advance_to(S)
    loop.call_soon(timer.cancel)
    loop.run_until_idle()
    assert trace == []


def test_callbacks_run_in_their_context(loop: GrantedTimeLoop) -> None:
    variable = contextvars.ContextVar("variable", default="outside")
    seen: list[str] = []
    context = contextvars.copy_context()
    context.run(variable.set, "given")
    for schedule in (loop.call_soon, lambda *args, **options: loop.call_later(1, *args, **options)):
        schedule(lambda: seen.append(variable.get()), context=context)
        token = variable.set("at scheduling")
        schedule(lambda: seen.append(variable.get()))
        variable.reset(token)
    run(loop)
    assert seen == ["given", "at scheduling"] * 2


def test_sets_of_tasks_have_the_same_order_in_every_run() -> None:
    orders = []
    for _ in range(3):
        loop = GrantedTimeLoop()
        ballast = [bytes(number) for number in range(1000)]  # other addresses each time
        tasks = [loop.create_task(asyncio.sleep(1)) for _ in range(50)]
        orders.append([tasks.index(task) for task in asyncio.all_tasks(loop)])
        assert len({hash(task) for task in tasks}) == 50
        run(loop)
        loop.close()
        del ballast
    assert orders[0] == orders[1] == orders[2]


def test_numbered_tasks_count_from_zero_for_each_factory() -> None:
    loop = GrantedTimeLoop()
    for _ in range(2):
        loop.set_task_factory(numbered_tasks())
        assert [hash(loop.create_task(asyncio.sleep(0))) for _ in range(3)] == [0, 1, 2]
    loop.run_until_idle()
    loop.close()


# ---- asyncio's parts


def test_timeout_and_wait_for_end_what_takes_too_long(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)

    async def behaviour() -> None:
        try:
            async with asyncio.timeout(0.5):
                await asyncio.sleep(2)
        except TimeoutError:
            note("timeout")
        try:
            await asyncio.wait_for(asyncio.sleep(2), 0.25)
        except TimeoutError:
            note("wait_for")
        note(await asyncio.wait_for(asyncio.sleep(0.25, "in time"), 5))

    loop.create_task(behaviour())
    run(loop)
    assert trace == [("timeout", S // 2), ("wait_for", 3 * S // 4), ("in time", S)]


def test_a_failing_task_group_cancels_its_other_children(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)

    async def child(name: str, delay_s: float) -> None:
        try:
            await asyncio.sleep(delay_s)
        except asyncio.CancelledError:
            note(f"{name} cancelled")
            raise
        raise ValueError(name)

    async def behaviour() -> None:
        try:
            async with asyncio.TaskGroup() as group:
                for name, delay_s in (("a", 3), ("b", 1), ("c", 2)):
                    group.create_task(child(name, delay_s))
        except* ValueError as errors:
            note(str(errors.exceptions))

    loop.create_task(behaviour())
    run(loop)
    assert trace == [("a cancelled", S), ("c cancelled", S), ("(ValueError('b'),)", S)]


def test_cancelling_a_task_group_from_outside(loop: GrantedTimeLoop) -> None:
    async def behaviour() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(asyncio.sleep(5))

    task = loop.create_task(behaviour())
    loop.call_later(1, task.cancel)
    run(loop)
    assert task.cancelled()
    assert loop.now_ns == S


def test_queue_event_and_condition(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)
    queue: asyncio.Queue[int] = asyncio.Queue(maxsize=1)
    event = asyncio.Event()
    condition = asyncio.Condition()

    async def produce() -> None:
        for number in range(3):
            await queue.put(number)
        event.set()
        async with condition:
            await condition.wait()
        note("notified")

    async def consume() -> None:
        for _ in range(3):
            await asyncio.sleep(1)
            note(await queue.get())
        await event.wait()
        note("event")
        await asyncio.sleep(1)
        async with condition:
            condition.notify()

    loop.create_task(produce())
    loop.create_task(consume())
    run(loop)
    assert trace == [(0, S), (1, 2 * S), (2, 3 * S), ("event", 3 * S), ("notified", 4 * S)]


def test_the_running_loop_and_task_are_known_inside_and_only_there(loop: GrantedTimeLoop) -> None:
    async def behaviour() -> tuple[object, object, bool]:
        return asyncio.get_running_loop(), asyncio.current_task(), loop.is_running()

    task = loop.create_task(behaviour())
    loop.run_until_idle()
    assert task.result() == (loop, task, True)
    assert not loop.is_running()
    with pytest.raises(RuntimeError, match="no running event loop"):
        asyncio.get_running_loop()


async def numbers(note: Callable[[Any], None]) -> AsyncIterator[int]:
    try:
        yield 1
        yield 2
    finally:
        await asyncio.sleep(1)
        note("closed")


def test_an_abandoned_generator_is_closed_by_the_loop(loop: GrantedTimeLoop, trace: Trace) -> None:
    async def behaviour() -> None:
        async for _ in numbers(noter(loop, trace)):
            return

    hooks = sys.get_asyncgen_hooks()
    loop.create_task(behaviour())
    run(loop)
    assert trace == [("closed", S)]
    assert sys.get_asyncgen_hooks() == hooks


def test_shutdown_closes_generators_that_are_still_open(loop: GrantedTimeLoop, trace: Trace) -> None:
    generator = numbers(noter(loop, trace))

    async def behaviour() -> None:
        await anext(generator)

    loop.create_task(behaviour())
    loop.run_until_idle()
    task = loop.create_task(loop.shutdown_asyncgens())
    run(loop)
    assert task.done()
    assert trace == [("closed", S)]


# ---- many loops, one thread


def test_loops_take_turns_in_one_thread(trace: Trace) -> None:
    loops = [GrantedTimeLoop() for _ in range(3)]

    async def behaviour(robot: int) -> None:
        while True:
            await asyncio.sleep(1 + robot)
            assert asyncio.get_running_loop() is loops[robot]
            trace.append((robot, loops[robot].now_ns // S))

    for robot, loop in enumerate(loops):
        loop.create_task(behaviour(robot))
    for now_s in range(4):
        for loop in loops:
            loop.advance_to(now_s * S)
            loop.run_until_idle()
    assert trace == [(0, 1), (0, 2), (1, 2), (0, 3), (2, 3)]
    for loop in loops:
        for task in asyncio.all_tasks(loop):
            task.cancel()
        loop.run_until_idle()
        loop.close()


def test_a_loop_does_not_run_inside_a_loop(loop: GrantedTimeLoop) -> None:
    other = GrantedTimeLoop()
    messages: list[str] = []

    def nest(inner: GrantedTimeLoop) -> None:
        try:
            inner.run_until_idle()
        except RuntimeError as error:
            messages.append(str(error))

    loop.call_soon(nest, loop)
    loop.call_soon(nest, other)
    loop.run_until_idle()
    assert messages == [
        "This event loop is already running",
        "Cannot run the event loop while another loop is running",
    ]
    other.close()


# ---- errors and ends


@pytest.mark.parametrize("debug", [False, True])
def test_an_exception_in_a_callback_goes_to_the_handler(
    loop: GrantedTimeLoop, trace: Trace, debug: bool
) -> None:
    contexts: list[dict[str, Any]] = []
    loop.set_debug(debug)
    loop.set_exception_handler(lambda _loop, context: contexts.append(context))
    handles = [loop.call_soon(divmod, 1, 0), loop.call_later(0, divmod, 2, 0)]
    loop.call_soon(noter(loop, trace), "still runs")
    loop.run_until_idle()
    assert trace == [("still runs", 0)]
    assert [context["handle"] for context in contexts] == handles
    assert all(isinstance(context["exception"], ZeroDivisionError) for context in contexts)
    assert "divmod" in contexts[0]["message"]
    for context in contexts:
        assert ("source_traceback" in context) == debug
        if debug:
            assert context["source_traceback"][-1].filename == __file__


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_propagates_and_the_loop_can_go_on(
    loop: GrantedTimeLoop, trace: Trace, error: type[BaseException]
) -> None:
    def interrupt() -> None:
        raise error

    hooks = sys.get_asyncgen_hooks()
    loop.call_soon(interrupt)
    loop.call_soon(noter(loop, trace), "later")
    with pytest.raises(error):
        loop.run_until_idle()
    assert not loop.is_running()
    assert sys.get_asyncgen_hooks() == hooks
    assert trace == []
    loop.run_until_idle()
    assert trace == [("later", 0)]


def test_waiting_by_spinning_is_reported(loop: GrantedTimeLoop) -> None:
    async def spin() -> None:
        while loop.time() < 1:
            await asyncio.sleep(0)

    task = loop.create_task(spin())
    loop.rounds_limit = 1000
    with pytest.raises(RuntimeError, match=r"not idle after 1000 rounds at 0 ns.*sleep\(0\)"):
        loop.run_until_idle()
    task.cancel()
    loop.run_until_idle()
    assert task.cancelled()


def test_debug_mode_checks_what_asyncio_checks(loop: GrantedTimeLoop) -> None:
    async def coroutine_function() -> None: ...

    loop.set_debug(True)
    for schedule in (loop.call_soon, lambda callback: loop.call_later(1, callback)):
        with pytest.raises(TypeError, match="coroutines cannot be used"):
            schedule(coroutine_function)
    with pytest.raises(TypeError, match="coroutines cannot be used"):
        loop.run_in_executor(None, coroutine_function)
    depths = []
    loop.call_soon(lambda: depths.append(sys.get_coroutine_origin_tracking_depth()))
    loop.run_until_idle()
    assert depths[0] > 0
    assert sys.get_coroutine_origin_tracking_depth() == 0


def test_ways_to_run_that_would_move_time_are_refused(loop: GrantedTimeLoop) -> None:
    with pytest.raises(RuntimeError, match=r"advance_to\(\)"):
        loop.run_forever()
    with pytest.raises(RuntimeError, match="run_until_idle"):
        loop.run_until_complete(asyncio.sleep(1))
    with pytest.raises(RuntimeError, match="end the tasks"):
        loop.stop()


def test_signals_are_refused(loop: GrantedTimeLoop) -> None:
    with pytest.raises(NotImplementedError, match="wall time"):
        loop.add_signal_handler(15, print)


def test_a_closed_loop_does_nothing_more() -> None:
    loop = GrantedTimeLoop()
    loop.call_later(1, print)
    loop.call_soon(print)
    loop.close()
    loop.close()
    assert loop.next_deadline() is None
    for use in (
        loop.run_until_idle,
        lambda: loop.call_soon(print),
        lambda: loop.call_later(1, print),
        lambda: loop.run_in_executor(None, print),
    ):
        with pytest.raises(RuntimeError, match="closed"):
            use()


def test_closing_leaves_nothing_open() -> None:
    gc.collect()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loop = GrantedTimeLoop()
        loop.create_task(asyncio.to_thread(int))
        loop.run_until_idle()
        loop.close()
        del loop
        gc.collect()
    assert caught == []


# ---- threads


def test_work_in_a_thread_takes_no_virtual_time(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)

    async def behaviour() -> None:
        async with asyncio.timeout(0.001):
            await asyncio.to_thread(time.sleep, 0.02)
            note("slept")
        note(await asyncio.to_thread(lambda: 42))

    loop.create_task(behaviour())
    loop.run_until_idle()
    assert trace == [("slept", 0), (42, 0)]


def test_an_error_in_a_thread_is_raised_where_it_is_awaited(loop: GrantedTimeLoop) -> None:
    task = loop.create_task(asyncio.to_thread(divmod, 1, 0))
    loop.run_until_idle()
    assert isinstance(task.exception(), ZeroDivisionError)


def test_results_come_in_order_of_submission_one_by_one(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)
    submitted: concurrent.futures.Future[concurrent.futures.Future[None]] = concurrent.futures.Future()

    class Recorder(concurrent.futures.ThreadPoolExecutor):
        def submit(self, *args: Any) -> concurrent.futures.Future[Any]:  # type: ignore[override]
            submission = super().submit(*args)
            if args[0] is second:
                submitted.set_result(submission)
            return submission

    def first() -> None:
        concurrent.futures.wait([submitted.result()])
        for _ in range(50):  # now the second is done and the loop is idle, again and again
            asyncio.run_coroutine_threadsafe(asyncio.sleep(0), loop).result()

    def second() -> None: ...

    async def behaviour(work: Callable[[], None]) -> None:
        await loop.run_in_executor(executor, work)
        note(work.__name__)
        for _ in range(3):
            await asyncio.sleep(0)
        note(f"{work.__name__} went on")

    with Recorder(2) as executor:
        loop.create_task(behaviour(first))
        loop.create_task(behaviour(second))
        loop.run_until_idle()
    assert [what for what, _ in trace] == ["first", "first went on", "second", "second went on"]


def test_cancelling_drops_the_result_but_the_work_is_waited_for(loop: GrantedTimeLoop, trace: Trace) -> None:
    go = threading.Event()
    finished = []

    def work() -> None:
        go.wait()
        finished.append(True)

    task = loop.create_task(asyncio.to_thread(work))
    following = loop.create_task(asyncio.to_thread(lambda: "delivered"))
    loop.call_soon(lambda: loop.call_soon(task.cancel))
    loop.call_soon(lambda: loop.call_soon(lambda: loop.call_soon(go.set)))
    loop.run_until_idle()
    assert task.cancelled()
    assert finished == [True]
    assert following.result() == "delivered"


def test_work_that_no_thread_has_begun_runs_even_when_cancelled(loop: GrantedTimeLoop) -> None:
    go = threading.Event()
    ran: list[bool] = []
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        loop.run_in_executor(executor, go.wait)
        queued = loop.run_in_executor(executor, ran.append, True)
        queued.cancel()
        loop.call_soon(go.set)
        loop.run_until_idle()
    assert ran == [True]


def test_work_withdrawn_by_its_executor_is_cancelled(loop: GrantedTimeLoop) -> None:
    go = threading.Event()
    executor = concurrent.futures.ThreadPoolExecutor(1)
    loop.run_in_executor(executor, go.wait)
    queued = loop.run_in_executor(executor, print)
    executor.shutdown(wait=False, cancel_futures=True)
    go.set()
    loop.run_until_idle()
    assert queued.cancelled()


def test_a_thread_can_call_back_while_the_loop_waits_for_it(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)

    async def answer(number: int) -> int:
        await asyncio.sleep(0)
        return number + 1

    def work() -> int:
        called = threading.Event()
        loop.call_soon_threadsafe(note, "from the thread")
        loop.call_soon_threadsafe(called.set)
        called.wait()
        return asyncio.run_coroutine_threadsafe(answer(41), loop).result()

    task = loop.create_task(asyncio.to_thread(work))
    loop.run_until_idle()
    assert task.result() == 42
    assert trace == [("from the thread", 0)]


def test_a_coroutine_cancelled_under_a_thread_cancels_its_awaiter(loop: GrantedTimeLoop) -> None:
    async def give_up() -> None:
        raise asyncio.CancelledError

    task = loop.create_task(
        asyncio.to_thread(lambda: asyncio.run_coroutine_threadsafe(give_up(), loop).result())
    )
    loop.run_until_idle()
    assert task.cancelled()


def test_what_another_thread_asked_for_between_runs_is_run(loop: GrantedTimeLoop, trace: Trace) -> None:
    thread = threading.Thread(target=loop.call_soon_threadsafe, args=(noter(loop, trace), "asked"))
    thread.start()
    thread.join()
    loop.run_until_idle()
    assert trace == [("asked", 0)]


def test_a_loop_may_be_closed_under_working_threads() -> None:
    loop = GrantedTimeLoop()
    go = threading.Event()
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        future = loop.run_in_executor(executor, go.wait)
        loop.close()
        go.set()
    assert not future.done()


def test_shutting_down_the_executor_waits_for_its_work(loop: GrantedTimeLoop, trace: Trace) -> None:
    note = noter(loop, trace)
    go = threading.Event()

    async def shut_down() -> None:
        await loop.shutdown_default_executor()
        note("shut down")

    loop.run_in_executor(None, go.wait).add_done_callback(lambda _: note("work done"))
    loop.create_task(shut_down())
    loop.call_soon(lambda: loop.call_soon(go.set))
    loop.run_until_idle()
    assert [what for what, _ in trace] == ["work done", "shut down"]
    with pytest.raises(RuntimeError, match="shutdown"):
        loop.run_in_executor(None, print)


def test_shutting_down_an_executor_that_was_never_used(loop: GrantedTimeLoop) -> None:
    task = loop.create_task(loop.shutdown_default_executor())
    loop.run_until_idle()
    assert task.done()


# ---- file descriptors


def test_descriptors_are_polled_and_never_waited_for(loop: GrantedTimeLoop, trace: Trace) -> None:
    ours, theirs = socket.socketpair()
    note = noter(loop, trace)
    with ours, theirs:
        loop.add_reader(ours, lambda: note(ours.recv(10)))
        loop.run_until_idle()
        assert trace == []
        theirs.send(b"one")
        loop.run_until_idle()
        assert trace == [(b"one", 0)]
        loop.remove_reader(ours)
        theirs.send(b"two")
        loop.run_until_idle()
        assert trace == [(b"one", 0)]


def test_a_task_that_spins_on_a_descriptor_gets_its_data(loop: GrantedTimeLoop, trace: Trace) -> None:
    ours, theirs = socket.socketpair()
    got: list[bytes] = []

    async def spin() -> None:
        loop.call_soon(theirs.send, b"data")
        while not got:
            await asyncio.sleep(0)

    with ours, theirs:
        loop.add_reader(ours, lambda: got.append(ours.recv(10)))
        task = loop.create_task(spin())
        loop.run_until_idle()
        loop.remove_reader(ours)
    assert task.done()
    assert got == [b"data"]


# ---- what becomes of tasks is not left to the garbage collector


@pytest.fixture
def _no_collector() -> Iterator[None]:
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def test_a_task_that_nobody_can_wake_is_kept_until_it_is_cancelled(
    loop: GrantedTimeLoop, trace: Trace
) -> None:
    note = noter(loop, trace)

    async def waits_for_ever() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            note("ended")

    loop.create_task(waits_for_ever())
    run(loop)
    gc.collect()
    run(loop)
    assert trace == []
    (task,) = asyncio.all_tasks(loop)
    task.cancel()
    run(loop)
    assert trace == [("ended", 0)]


@pytest.mark.usefixtures("_no_collector")
def test_what_has_ended_is_not_kept(loop: GrantedTimeLoop, trace: Trace) -> None:
    ended = [weakref.ref(loop.create_task(asyncio.sleep(number))) for number in range(500)]
    run(loop)
    assert [each() for each in ended] == [None] * 500


@pytest.mark.usefixtures("_no_collector")
def test_a_failure_that_nobody_asks_for_is_told_of_as_soon_as_on_asyncios_loop(
    loop: GrantedTimeLoop, trace: Trace
) -> None:
    note = noter(loop, trace)

    async def fails() -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(1):
                await asyncio.sleep(2)
        raise ValueError

    async def waits() -> None:
        await asyncio.wait([asyncio.ensure_future(fails())])
        note("waited")

    loop.set_exception_handler(lambda _loop, context: note(context["message"]))
    loop.create_task(waits())
    run(loop)
    assert trace == [("NumberedTask exception was never retrieved", S), ("waited", S)]
