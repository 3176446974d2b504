"""Programs do the same things in the same order on the granted loop as on asyncio's own."""

from __future__ import annotations

import asyncio
import gc
import selectors
from collections.abc import Callable
from functools import partial
from typing import Any

from hypothesis import HealthCheck, assume, given, reject, settings
from hypothesis import strategies as st

from agent.numbered_tasks import numbered_tasks
from agent.virtual_time import GrantedTimeLoop
from tests.properties.asyncio_programs import Op, Player, Program, bursts, programs

TICK_S = 0.1
REAL_TICKS_S = (0.003, 0.006, 0.012, 0.03)
Trace = list[tuple[str, int]]


class JumpSelector(selectors.DefaultSelector):
    """The oracle's clock: where asyncio would sleep, time jumps to the end of the sleep (to the ns)."""

    now_s = 0.0
    stop: Callable[[], None]

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events = super().select(0)
        if not events and timeout is None:
            self.stop()
        elif not events and timeout is not None:
            self.now_s = round((self.now_s + timeout) * 1e9) / 1e9
        return events


def jumping_loop() -> asyncio.SelectorEventLoop:
    selector = JumpSelector()
    loop = asyncio.SelectorEventLoop(selector)
    selector.stop = loop.stop
    loop.time = lambda: selector.now_s  # type: ignore[method-assign]
    # Sets of asyncio's own tasks have the order of memory addresses: nothing to compare with.
    loop.set_task_factory(numbered_tasks())
    return loop


def run_granted(loop: asyncio.AbstractEventLoop) -> None:
    assert isinstance(loop, GrantedTimeLoop)
    loop.run_until_idle()
    while (deadline_ns := loop.next_deadline()) is not None:
        assert deadline_ns > loop.now_ns
        loop.advance_to(deadline_ns)
        loop.run_until_idle()


def run_granted_without_ties(loop: asyncio.AbstractEventLoop) -> None:
    """The same, for programs in which no two timers end at one instant; others are not tried."""
    assert isinstance(loop, GrantedTimeLoop)
    loop.run_until_idle()
    while (deadline_ns := loop.next_deadline()) is not None:
        live = [timer for timer in loop._scheduled if not timer.cancelled()]
        assume(sum(round(timer.when() * 1e9) == deadline_ns for timer in live) == 1)
        loop.advance_to(deadline_ns)
        loop.run_until_idle()


def trace_of(
    program: Program,
    loop: asyncio.AbstractEventLoop,
    run: Callable[[asyncio.AbstractEventLoop], None],
    tick_s: float,
) -> Trace:
    """What happens when the program is played, each with the loop's time since the start in ns."""
    trace: Trace = []
    open_ended = True
    start_s = loop.time()

    def note(label: str) -> None:
        if open_ended:
            trace.append((label, round((loop.time() - start_s) * 1e9)))

    async def play() -> None:
        await Player(program, tick_s, note).play()

    def handle(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        # When an exception that nobody asks for is told of is up to references, not to the loop.
        if "never retrieved" not in context["message"]:
            note(f"handler: {context['message']}")

    loop.set_exception_handler(handle)
    loop.create_task(play())
    try:
        run(loop)
    finally:
        open_ended = False
        end_all(loop)
        loop.close()
    return trace


def end_all(loop: asyncio.AbstractEventLoop) -> None:
    while tasks := asyncio.all_tasks(loop):
        for task in tasks:
            task.cancel()
        if isinstance(loop, GrantedTimeLoop):
            loop.run_until_idle()
        else:
            loop.call_soon(loop.stop)
            loop.run_forever()


TIED_TICKS = st.sampled_from([0, 1, 1, 2, 2, 3, 5, 10])
UNTIED_TICKS = st.integers(1, 15)


def expected_of(program: Program) -> Trace:
    return trace_of(program, jumping_loop(), lambda loop: loop.run_forever(), TICK_S)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(programs(TIED_TICKS))
def test_programs_do_the_same_on_asyncios_loop(program: Program) -> None:
    assert trace_of(program, GrantedTimeLoop(), run_granted, TICK_S) == expected_of(program)


@settings(max_examples=60, deadline=None)
@given(programs(TIED_TICKS))
def test_the_garbage_collector_has_no_say(program: Program) -> None:
    def run_and_collect(loop: asyncio.AbstractEventLoop) -> None:
        assert isinstance(loop, GrantedTimeLoop)
        loop.run_until_idle()
        while (deadline_ns := loop.next_deadline()) is not None:
            gc.collect()
            loop.advance_to(deadline_ns)
            loop.run_until_idle()
        gc.collect()
        loop.run_until_idle()

    gc.disable()
    try:
        undisturbed = trace_of(program, GrantedTimeLoop(), run_granted, TICK_S)
    finally:
        gc.enable()
    assert trace_of(program, GrantedTimeLoop(), run_and_collect, TICK_S) == undisturbed


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.lists(bursts() | st.just(("sleep", 1)), min_size=1, max_size=3).map(tuple), min_size=1, max_size=3
    )
)
def test_ties_among_many_timers_come_out_as_on_asyncios_loop(tasks: list[tuple[Op, ...]]) -> None:
    program = tuple(tasks)
    assert trace_of(program, GrantedTimeLoop(), run_granted, TICK_S) == expected_of(program)


@settings(max_examples=50, deadline=None)
@given(programs(TIED_TICKS), st.integers(0, 7_990_000))
def test_programs_do_the_same_at_any_time_of_the_run(program: Program, eighths: int) -> None:
    # Eighths of a second are exact as floats, so that ties stay ties 11 days later.
    at_start = trace_of(program, GrantedTimeLoop(), run_granted, 0.125)
    later = trace_of(program, GrantedTimeLoop(eighths * 125_000_000), run_granted, 0.125)
    assert later == at_start


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)
@given(programs(UNTIED_TICKS))
def test_programs_keep_their_order_in_real_time(program: Program) -> None:
    virtual = trace_of(program, GrantedTimeLoop(), run_granted_without_ties, TICK_S)
    in_ticks = {label: time_ns / TICK_S / 1e9 for label, time_ns in virtual}
    last_tick = virtual[-1][1] / TICK_S / 1e9
    assume(len(virtual) > 10 and 1 < last_tick < 30)
    for tick_s in REAL_TICKS_S:
        real = trace_of(program, real_loop(), partial(run_for, (last_tick + 1) * tick_s), tick_s)
        late_ticks = max(abs(time_ns / tick_s / 1e9 - in_ticks.get(label, 0)) for label, time_ns in real)
        if late_ticks < 0.4:
            assert [label for label, _ in real] == [label for label, _ in virtual]
            return
    reject()  # a machine this busy is no oracle: timers of different instants came due together


def real_loop() -> asyncio.SelectorEventLoop:
    loop = asyncio.SelectorEventLoop(selectors.SelectSelector())  # epoll would round sleeps up to 1 ms
    loop.set_task_factory(numbered_tasks())
    return loop


def run_for(duration_s: float, loop: asyncio.AbstractEventLoop) -> None:
    def stop(passes_left: int) -> None:
        # What came due together with this is to happen and to be noted, that it may be seen to be late.
        if passes_left:
            loop.call_soon(stop, passes_left - 1)
        else:
            loop.stop()

    loop.call_later(duration_s, stop, 50)
    loop.run_forever()
