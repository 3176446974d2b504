"""Estimates on the air, byte by byte, and degrees against published lengths."""

from __future__ import annotations

import math

import pytest

from agent.behaviours.dissemination.estimates import Estimate
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.wire import ESTIMATE_BITS, ESTIMATE_BYTES, PacketError, Wire

PLANE = TangentPlane((42.36, -71.09))


def test_size_is_the_papers() -> None:
    assert ESTIMATE_BYTES == 24
    assert ESTIMATE_BITS == 192


def test_bytes_by_hand() -> None:
    packet = Wire(PLANE, 9).pack([Estimate(3, 258, 0.0, 0.0, -1.5, 0.5)])
    assert packet[:4] == b"\x00\x00\x00\x03"
    assert packet[4:8] == b"\x00\x00\x01\x02"
    assert packet[8:12] == (423_600_000).to_bytes(4, "big")
    assert packet[12:16] == (-710_900_000).to_bytes(4, "big", signed=True)
    assert packet[16:20] == b"\xff\xff\xfa\x24"  # -1500 mm
    assert packet[20:] == (500_000).to_bytes(4, "big")


def test_a_packet_is_the_concatenation_of_its_estimates() -> None:
    wire = Wire(PLANE, 9)
    one, other = Estimate(3, 5, 1.0, 2.0, 3.0, 0.1), Estimate(0, 6, -1.0, -2.0, -3.0, -0.1)
    assert wire.pack([one, other]) == wire.pack([one]) + wire.pack([other])
    assert [it.number for it in wire.unpack(wire.pack([one, other]))] == [3, 0]
    assert wire.unpack(b"") == []


def test_there_and_back_within_the_resolution() -> None:
    sent = Estimate(8, 2**31 - 1, 1234.567, -987.654, 321.0987, 3.0)
    (got,) = Wire(PLANE, 9).unpack(Wire(PLANE, 9).pack([sent]))
    assert (got.number, got.time_ms) == (8, 2**31 - 1)
    assert got.x_m == pytest.approx(sent.x_m, abs=0.0056)  # half of 1e-7 degrees
    assert got.y_m == pytest.approx(sent.y_m, abs=0.0056)
    assert got.z_m == pytest.approx(sent.z_m, abs=0.00051)
    assert got.yaw_rad == pytest.approx(sent.yaw_rad, abs=5.1e-7)


@pytest.mark.parametrize(
    ("yaw", "turned"),
    [
        (math.pi, math.pi),
        (-math.pi, -math.pi),
        (7.0, 7.0 - math.tau),
        (-4.0, math.tau - 4.0),
        (100.0, 100.0 - 16 * math.tau),
    ],
)
def test_yaw_is_turned_into_half_a_turn_either_way(yaw: float, turned: float) -> None:
    wire = Wire(PLANE, 1)
    (got,) = wire.unpack(wire.pack([Estimate(0, 0, 0.0, 0.0, 0.0, yaw)]))
    assert got.yaw_rad == pytest.approx(turned, abs=1e-6)


@pytest.mark.parametrize(
    ("estimate", "named"),
    [
        (Estimate(9, 0, 0.0, 0.0, 0.0, 0.0), "number: an estimate has 9; it must lie within 0 to 8"),
        (Estimate(-1, 0, 0.0, 0.0, 0.0, 0.0), "number: an estimate has -1"),
        (Estimate(0, -1, 0.0, 0.0, 0.0, 0.0), "time stamp: an estimate has -1"),
        (Estimate(0, 2**31, 0.0, 0.0, 0.0, 0.0), "time stamp: an estimate has 2147483648"),
        (Estimate(0, 0, 0.0, 5.4e6, 0.0, 0.0), "latitude: "),
        (Estimate(0, 0, 0.0, 0.0, 2_147_483.648, 0.0), "altitude: an estimate has 2147483648"),
        (Estimate(0, 0, math.nan, 0.0, 0.0, 0.0), "longitude: of robot 0 is nan; it must be finite"),
        (Estimate(0, 0, 0.0, math.inf, 0.0, 0.0), "latitude: of robot 0 is inf"),
        (Estimate(0, 0, 0.0, 0.0, -math.inf, 0.0), "altitude: of robot 0 is -inf"),
        (Estimate(0, 0, 0.0, 0.0, 0.0, math.inf), "yaw: of robot 0 is"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_not_sent(estimate: Estimate, named: str) -> None:
    with pytest.raises(PacketError, match=named):
        Wire(PLANE, 9).pack([estimate])


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        (0, 9, "number"), (0, -1, "number"), (1, -1, "time stamp"), (2, 900_000_001, "latitude"),
        (2, -900_000_001, "latitude"), (3, 1_800_000_001, "longitude"), (5, 3_141_594, "yaw"),
    ],
)  # fmt: skip
def test_what_nobody_can_have_sent_is_refused(field: int, value: int, named: str) -> None:
    fields = [0, 0, 0, 0, 0, 0]
    fields[field] = value
    with pytest.raises(PacketError, match=f"{named}: an estimate has {value}"):
        Wire(PLANE, 9).unpack(b"".join(it.to_bytes(4, "big", signed=True) for it in fields))


@pytest.mark.parametrize("size", [1, 23, 25, 47])
def test_torn_packets_are_refused(size: int) -> None:
    with pytest.raises(PacketError, match=f"packet: {size} bytes are no whole number of estimates of 24"):
        Wire(PLANE, 9).unpack(bytes(size))


@pytest.mark.parametrize(
    ("latitude", "north_m", "east_m"),  # lengths of a degree on WGS 84, as published
    [(0.0, 110_574.3, 111_319.5), (15.0, 110_649, 107_550), (45.0, 111_131.7, 78_846.8), (-60.0, 111_412, 55_800)],
)  # fmt: skip
def test_lengths_of_a_degree(latitude: float, north_m: float, east_m: float) -> None:
    plane = TangentPlane((latitude, 10.0))
    assert plane.to_metres(latitude + 1, 11.0) == pytest.approx((east_m, north_m), abs=1.0)
    assert plane.to_degrees(east_m, north_m) == pytest.approx((latitude + 1, 11.0), abs=1e-5)


def test_across_the_date_line() -> None:
    plane = TangentPlane((0.0, 179.9999))
    latitude, longitude = plane.to_degrees(100.0, 0.0)
    assert longitude == pytest.approx(-180 + 100 / 111_319.49 - 0.0001, abs=1e-7)
    assert plane.to_metres(latitude, longitude) == pytest.approx((100.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("origin", "named"),
    [((89.5, 0.0), "latitude"), ((math.nan, 0.0), "latitude"), ((0.0, 181.0), "longitude"), ((0.0, math.nan), "longitude")],
)  # fmt: skip
def test_origins_that_are_none(origin: tuple[float, float], named: str) -> None:
    with pytest.raises(ValueError, match=f"origin_deg: {named} must lie within"):
        TangentPlane(origin)
