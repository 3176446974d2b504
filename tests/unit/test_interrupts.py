"""Signals that come in the middle of something take effect after it, and none is lost."""

from __future__ import annotations

import contextlib
import signal
import threading

import pytest

from emulator.interrupts import check, held, noted, waiting


@pytest.mark.parametrize("inside_a_run", [True, False])
def test_a_signal_waits_for_what_is_held(inside_a_run: bool) -> None:
    before = signal.getsignal(signal.SIGINT)
    done: list[str] = []

    def write() -> None:
        with held():
            signal.raise_signal(signal.SIGINT)
            done.append("first half")
            with held():  # nested: still not the time
                done.append("second half")
            done.append("closed")
        check()
        done.append("never reached")

    with pytest.raises(KeyboardInterrupt), noted() if inside_a_run else contextlib.nullcontext():
        write()
    assert done == ["first half", "second half", "closed"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_signal_during_a_run_is_raised_when_it_is_asked_for() -> None:
    done: list[str] = []

    def run() -> None:
        with noted():
            signal.raise_signal(signal.SIGINT)
            done.append("the instant is finished")
            check()
            done.append("never reached")

    with pytest.raises(KeyboardInterrupt):
        run()
    assert done == ["the instant is finished"]
    check()  # nothing is left over


def test_a_signal_that_nobody_asked_for_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), noted():
        signal.raise_signal(signal.SIGINT)


def test_while_waiting_and_for_the_second_time_it_is_raised_at_once() -> None:
    done: list[str] = []

    def wait() -> None:
        with noted(), waiting():
            signal.raise_signal(signal.SIGINT)
            done.append("never reached")

    def insist() -> None:
        with noted():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append("never reached")

    with pytest.raises(KeyboardInterrupt):
        wait()
    with pytest.raises(KeyboardInterrupt):
        insist()
    assert done == []


def test_handlers_of_others_are_called() -> None:
    called: list[int] = []
    previous = signal.signal(signal.SIGTERM, lambda number, _frame: called.append(number))
    try:
        with noted(), held():
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGTERM)
            assert called == []
        assert called == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, previous)


def test_elsewhere_than_in_the_main_thread_nothing_happens() -> None:
    done: list[bool] = []

    def work() -> None:
        with noted(), held():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]


def test_one_that_comes_while_handlers_are_put_back_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    put_back = signal.signal

    def interrupted(number: int, handler: object) -> object:
        if number == signal.SIGINT and handler is before:  # the last moment at which it is only noted
            signal.raise_signal(signal.SIGINT)
        return put_back(number, handler)  # type: ignore[arg-type]

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), noted():
        monkeypatch.setattr(signal, "signal", interrupted)
    assert signal.getsignal(signal.SIGINT) is before
