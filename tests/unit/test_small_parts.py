"""Mail, lamps and pacing: small parts of the broker, each by hand."""

from __future__ import annotations

from msgspec import Raw

from emulator.lamps import Lamps
from emulator.mail import Mail
from emulator.pacing import Pacer

A, B, C, D = (Raw(letter) for letter in (b"a", b"b", b"c", b"d"))


def letters(items: list[Raw]) -> str:
    return b"".join(bytes(item) for item in items).decode()


def test_mail_comes_in_order_of_arrival_and_equals_in_order_of_posting() -> None:
    mail = Mail(2)
    for arrival, item in ((30, C), (10, A), (20, B), (30, D)):
        mail.post(1, arrival, item)
    assert mail.next_arrival(1) == 10
    assert letters(mail.take(1, 9)) == ""
    assert letters(mail.take(1, 20)) == "ab"
    assert mail.next_arrival(1) == 30
    mail.post(1, 30, A)
    assert letters(mail.take(1, 100)) == "cda"
    assert mail.next_arrival(1) is None
    assert mail.take(0, 100) == []


def test_lamps_change_when_their_commands_take_effect() -> None:
    lamps = Lamps(2, latency_ns=5)
    lamps.command(0, now_ns=0, at_ns=0, colour=1)
    lamps.command(0, now_ns=0, at_ns=100, colour=0)
    lamps.command(1, now_ns=50, at_ns=20, colour=2)  # asked for in the past: takes effect from now
    assert [lamps.colours(now).tolist() for now in (0, 4, 5, 54, 55, 104, 105)] == [
        [0, 0], [0, 0], [1, 0], [1, 0], [1, 2], [1, 2], [0, 2],
    ]  # fmt: skip


def test_of_two_commands_for_one_instant_the_later_given_wins() -> None:
    lamps = Lamps(1, latency_ns=1)
    lamps.command(0, 0, 10, 0)
    lamps.command(0, 10, 10, 3)
    assert lamps.colours(11).tolist() == [3]


def test_pacing_sleeps_until_the_time_has_come_and_counts_what_is_late() -> None:
    wall = [100.0]
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        wall[0] += seconds

    pacer = Pacer(2.0, clock=lambda: wall[0], sleep=sleep)
    pacer.wait_for(0)
    pacer.wait_for(1_000_000_000)
    assert slept == [0.5]
    wall[0] += 0.6  # half a virtual second takes a quarter: 0.35 s late
    pacer.wait_for(1_500_000_000)
    assert (pacer.overruns, round(pacer.worst_overrun_s, 6)) == (1, 0.35)
    pacer.wait_for(3_000_000_000)
    assert [round(seconds, 6) for seconds in slept] == [0.5, 0.4]


def test_without_a_rate_nobody_waits() -> None:
    pacer = Pacer(None, sleep=lambda _seconds: 1 / 0)
    pacer.wait_for(10**15)
    assert pacer.overruns == 0
