"""Scores of dissemination: records of a few lines, worked out by hand; and runs, against what robots log."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest
from msgspec.structs import replace

from agent.behaviours.dissemination.estimates import Estimate
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.wire import Wire
from emulator.run import Options
from emulator.run import run as run_scenario
from emulator.scenario_file import load
from logs.reader import LogReader
from logs.recorder import Recorder
from scenarios.coverage.cost import cost
from scenarios.coverage.score import coverage
from scenarios.coverage.score import score as score_coverage
from scenarios.dissemination.knowledge import (
    History,
    Knowledge,
    Transmission,
    knowledge,
    read,
    transmissions,
)
from scenarios.dissemination.lattices import Lattice
from scenarios.dissemination.score import MOST_DISTANCES, instants_s, places, score_history, slots_of
from scenarios.dissemination.stamps import received
from scenarios.runs import Record, team_of

NAMES = ("a", "b", "c", "d")
MS = 1_000_000
SLOT_MS = 128
"""Two estimates of 192 bits at 3000 bit/s."""
LATENCY_NS = 100
PLACES = ((0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (10.0, 10.0))
HEARD_BY = {"a": "bc", "b": "ad", "c": "ad", "d": "bc"}
SETTINGS: dict[str, Any] = {
    "seed": 1,
    "world": {"motion": {"kind": "static"}},
    "radio": {
        "range_m": 10.0, "access": "tdma", "bit_rate_bps": 3000.0, "overhead_bits": 0,
        "tdma": {"units": 2, "unit_bits": 192, "order": "fixed"},
    },
    "params": {"subgraphs": "2x2"},
}  # fmt: skip


def sent(
    turn: int,
    *said: tuple[str, int],
    to: str | None = None,
    late_ms: int = 0,
    sender: str | None = None,
    **changed: Any,
) -> Record:
    """What is said in one slot, counted from 0 over all frames: (whose, stamp in ms), heard by neighbours."""
    name = sender or NAMES[turn % 4]
    wire = Wire(TangentPlane((48.0, 11.0)), 4)
    packet = wire.pack(Estimate(NAMES.index(whose), stamp, 1.0, 2.0, 3.0, 0.0) for whose, stamp in said)
    airtime_ns = len(said) * SLOT_MS * MS // 2
    delivered = list(HEARD_BY[name] if to is None else to)
    record = {
        "from": name,
        "seq": 0,
        "payload": {"base64": base64.b64encode(packet).decode()},
        "bits": 8 * len(packet),
        "slot": turn % 4,
        "airtime_ns": airtime_ns,
        "delivered": delivered,
        "delay_ns": [LATENCY_NS] * len(delivered),
        "dropped": {},
    }
    return (turn * SLOT_MS + late_ms) * MS + airtime_ns, record | changed


TWO_FRAMES = [
    sent(0, ("a", 0)),
    sent(1, ("b", 128), ("a", 0)),
    sent(2, ("c", 256), ("a", 0)),
    sent(3, ("d", 384), ("b", 128)),
    sent(4, ("a", 512), ("b", 128)),
    sent(5, ("b", 640), ("d", 384)),
    sent(6, ("c", 768), ("d", 384)),
    sent(7, ("d", 896), ("c", 768)),
]
"""a hears of d in slot 5, and b of c, as the last of all, in slot 7."""


def start(places: Sequence[tuple[float, float]] = PLACES) -> Record:
    robots = [
        {"robot": name, "position_m": list(place), "heading_rad": 0.0, "velocity_mps": [0.0, 0.0]}
        for name, place in zip(NAMES, places, strict=True)
    ]
    return 0, {"kind": "start", "area_m": [20.0, 20.0], "robots": robots}


def history(
    radio: Sequence[Record] = TWO_FRAMES,
    end_ms: int = 8 * SLOT_MS,
    truth: Sequence[Record] = (start(),),
    **params: Any,
) -> History:
    settings = SETTINGS | {"params": SETTINGS["params"] | params}
    return History(
        robots=list(NAMES),
        truth=list(truth),
        ended_ns=[end_ms * MS] * 4,
        end_ns=end_ms * MS,
        settings=settings,
        transmissions=transmissions(radio, NAMES),
    )


def with_radio(before: History, tdma: Mapping[str, Any], **radio: Any) -> History:
    """The same under other rules."""
    changed = SETTINGS["radio"] | {"tdma": SETTINGS["radio"]["tdma"] | tdma} | radio
    return replace(before, settings=SETTINGS | {"radio": changed})


def known(radio: Sequence[Record]) -> Knowledge:
    return knowledge(transmissions(radio, NAMES), 4)


def rows(of: Knowledge) -> list[tuple[str, str, int, int]]:
    """Receiver, origin, reception and true time of the stamp [ms]."""
    return [
        (NAMES[receiver], NAMES[origin], received // MS, made // MS)
        for receiver, origin, received, made in zip(
            of.receiver.tolist(),
            of.origin.tolist(),
            of.received_ns.tolist(),
            of.made_ns.tolist(),
            strict=True,
        )
    ]


# --- who knew what -----------------------------------------------------------------------------------


def test_knowledge_by_hand() -> None:
    assert rows(known(TWO_FRAMES)) == [
        ("a", "b", 256, 128), ("a", "b", 768, 640), ("a", "c", 384, 256), ("a", "c", 896, 768), ("a", "d", 768, 384),
        ("b", "a", 64, 0), ("b", "a", 640, 512), ("b", "c", 1024, 768), ("b", "d", 512, 384), ("b", "d", 1024, 896),
        ("c", "a", 64, 0), ("c", "a", 640, 512), ("c", "b", 512, 128), ("c", "d", 512, 384), ("c", "d", 1024, 896),
        ("d", "a", 256, 0), ("d", "b", 256, 128), ("d", "b", 768, 640), ("d", "c", 384, 256), ("d", "c", 896, 768),
    ]  # fmt: skip


def test_what_is_not_strictly_newer_is_no_news() -> None:
    radio = [
        sent(0, ("a", 0)),
        sent(1, ("b", 128), ("a", 0)),
        sent(4, ("a", 512)),
        sent(3, ("d", 384), ("a", 0), to="bc"),
    ]
    assert [row for row in rows(known(radio)) if row[0] == "c"] == [
        ("c", "a", 64, 0), ("c", "a", 576, 512), ("c", "d", 512, 384),
    ]  # fmt: skip


def test_the_true_time_of_a_stamp_is_when_its_owner_first_sent_it() -> None:
    """Whatever the owner's clock says: this one is five seconds ahead."""
    radio = [
        sent(0, ("a", 5000)),
        sent(1, ("b", 128), ("a", 5000)),
        sent(4, ("a", 5512)),
        sent(8, ("a", 5512)),
    ]
    assert [row for row in rows(known(radio)) if row[1] == "a"] == [
        ("b", "a", 64, 0), ("b", "a", 576, 512), ("c", "a", 64, 0), ("c", "a", 576, 512), ("d", "a", 256, 0),
    ]  # fmt: skip


def test_a_stamp_that_its_owner_never_sent_cannot_be_dated_and_shuts_out_older_ones() -> None:
    radio = [
        sent(0, ("a", 0)),
        sent(1, ("b", 128), ("a", 700)),
        sent(2, ("c", 256), ("a", 0)),
        sent(4, ("a", 512)),
    ]
    found = known(radio)
    assert found.unexplained == 1
    assert [row for row in rows(found) if row[:2] == ("d", "a")] == []


@pytest.mark.parametrize(
    "payload",
    [
        {"hello": 1},
        "text",
        None,
        {"base64": "AAAA"},  # no whole number of estimates
        {"base64": "no base64!"},
        {"base64": base64.b64encode(bytes([0, 0, 0, 9] + [0] * 20)).decode()},  # robot 9 of 4
        {"base64": "", "more": 1},
    ],
)
def test_what_is_no_packet_tells_nothing(payload: Any) -> None:
    radio = [sent(0, ("a", 0), payload=payload), sent(1, ("b", 128))]
    assert {row[1] for row in rows(known(radio))} == {"b"}
    assert score_history(history(radio))["estimates_sent"] == 1


def test_who_joins_throws_away_what_had_arrived_by_then() -> None:
    """What arrives at that very instant as well; what is still on the way is heard."""
    radio = [sent(0, ("a", 0))]  # at b and c 64 ms and 100 ns after the start
    for joined_ns, heard in ((64 * MS, [1, 2]), (64 * MS + 99, [1, 2]), (64 * MS + 100, [2]), (65 * MS, [2])):
        (one,) = transmissions(radio, NAMES, {"b": joined_ns})
        assert one.receivers == heard
        assert one.received_ns == [64 * MS + LATENCY_NS] * len(heard)


def test_an_empty_log_tells_nothing() -> None:
    assert rows(known([])) == []
    assert rows(known([sent(0, to="")])) == []


def test_the_team_is_in_the_record_of_the_start() -> None:
    assert team_of([(0, {"kind": "visual ids"}), start()]) == list(NAMES)
    with pytest.raises(ValueError, match=r"^/truth: holds no record of the start"):
        team_of([])


# --- propagation -------------------------------------------------------------------------------------


def test_propagation_by_hand() -> None:
    found = score_history(history())["propagation"]
    assert found == {"2x2": {"s": 1.0240001, "units": 16, "frames": 2.0, "missing_pairs": 0}}


def test_propagation_is_not_complete_without_the_last_pair() -> None:
    found = score_history(history(TWO_FRAMES[:-1]))["propagation"]
    assert found == {"2x2": {"s": None, "units": None, "frames": None, "missing_pairs": 1}}


def test_a_short_packet_still_takes_its_slot() -> None:
    """The last one ends in the middle of its slot; units count until the slot's end."""
    radio = [*TWO_FRAMES[:-1], sent(7, ("c", 768), to="b")]
    found = score_history(history(radio))["propagation"]["2x2"]
    assert (found["s"], found["units"]) == (0.9600001, 16)


def test_only_members_of_the_part_count() -> None:
    """Nobody tells a of d; the middle two of a line of four do not care."""
    line = start([(10.0, 0.0), (10.0, 1.0), (10.0, 2.0), (10.0, 3.0)])
    radio = [*TWO_FRAMES[:5], sent(5, ("b", 640)), sent(6, ("c", 768)), TWO_FRAMES[7]]
    whole = history(radio, truth=[line], subgraphs="2x1,4x1")
    assert score_history(whole)["propagation"] == {
        "2x1": {"s": 1.0240001, "units": 16, "frames": 2.0, "missing_pairs": 0},
        "4x1": {"s": None, "units": None, "frames": None, "missing_pairs": 1},
    }


def test_robots_on_no_grid_have_no_parts() -> None:
    ragged = start([(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (10.0, 10.1)])
    uneven = start([(0.0, 0.0), (5.0, 0.0), (15.0, 0.0), (20.0, 0.0)])
    backwards = start([(10.0, 0.0), (0.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    for truth in (ragged, uneven, backwards):
        assert score_history(history(TWO_FRAMES, truth=[truth]))["propagation"] == {}


def test_all_parts_are_the_centred_squares() -> None:
    assert list(score_history(history(TWO_FRAMES, subgraphs="all"))["propagation"]) == ["2x2"]
    assert list(Lattice(10, 10, 4).parts("all")) == ["2x2", "4x4", "6x6", "8x8"]
    assert list(Lattice(5, 7, 4).parts("all")) == ["3x3", "5x5"]
    assert list(Lattice(4, 5, 4).parts("all")) == ["4x5"]


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({"subgraphs": "1x2"}, "subgraphs: 1x2 cannot be centred on 2x2"),
        ({"score_from_s": -1}, "params.score_from_s: must be a number, 0 or more, is -1"),
        ({"score_from_s": True}, "params.score_from_s: must be a number, 0 or more, is True"),
    ],
)
def test_params_that_make_no_sense(params: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match="^" + sentence):
        score_history(history(**params))


# --- ages --------------------------------------------------------------------------------------------


def test_ages_by_hand() -> None:
    """Of c about b and of a about d, the only ones from two hops away that are told of once only."""
    found = score_history(history())
    beyond = found["by_hops"]["2"]  # (a, d), (b, c), (c, b), (d, a): 14.1 m; b hears of c at the very end
    # Since: (a, d) 0.768 s, made at 0.384 s; (c, b) 0.512 s, at 0.128 s; (d, a) 0.256 s, at 0 s. Until 1.024 s.
    spans = [(0.768, 0.384), (0.512, 0.128), (0.256, 0.0)]
    integral = sum((1.024 - since) * ((since - made) + (1.024 - made)) / 2 for since, made in spans)
    assert beyond["age_s"]["mean"] == pytest.approx(
        integral / sum(1.024 - since for since, _ in spans), abs=1e-6
    )
    assert beyond["updates_per_minute"] == pytest.approx(3 / (4 * 1.024 / 60))
    assert [part["from_m"] for part in found["by_distance"]] == [5.0, 10.0]
    assert found["by_distance"][1]["age_s"] == beyond["age_s"]


def test_ages_from_a_later_instant_on() -> None:
    later = score_history(history(score_from_s=0.9))
    assert later["updates_per_minute"] == pytest.approx(0.0)  # what comes at 1.024 s comes after the end
    assert later["age_s"]["mean"] > score_history(history())["age_s"]["mean"]


# --- the radio ---------------------------------------------------------------------------------------


def test_costs_by_hand() -> None:
    found = score_history(history(end_ms=1600))
    assert (found["slot_s"], found["units_per_slot"], found["slots_per_frame"]) == (0.128, 2, 4)
    assert found["frame_rate_hz"] == pytest.approx(1 / 0.512)
    assert found["bytes_sent"] == 24 * 15
    assert found["estimates_sent"] == 15
    assert (found["slots_used"], found["slots_missed"]) == (8, 4)  # of three whole frames
    assert {key: column["a"] for key, column in found["per_robot"].items()} == {
        "bytes_sent": 72, "estimates_sent": 3, "slots_used": 2, "slots_missed": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    "wrong",
    [
        sent(3, ("d", 384), ("b", 128), late_ms=1),  # runs over the end
        sent(3, ("d", 384), late_ms=-1),  # begins too early
        sent(3, ("d", 384), dropped={"out_of_slot": ["b", "c"]}, to=""),
        sent(3, ("d", 384), dropped={"too_long": ["b", "c"]}, to=""),
        sent(3, ("d", 384), dropped={"queue_full": ["b", "c"]}, to="", airtime_ns=0),
        sent(2, ("d", 384), sender="d", slot=3),  # in somebody else's
        sent(3, ("d", 384), slot=None),
    ],
)
def test_a_slot_is_missed_by_who_does_not_keep_to_it(wrong: Record) -> None:
    found = score_history(history([*TWO_FRAMES[:3], wrong, *TWO_FRAMES[4:]]))
    assert (found["slots_used"], found["slots_missed"]) == (7, 1)
    assert found["per_robot"]["slots_missed"]["d"] == 1


def test_half_a_slot_late_is_in_time_for_a_short_packet() -> None:
    found = score_history(history([*TWO_FRAMES[:3], sent(3, ("d", 384), late_ms=64), *TWO_FRAMES[4:]]))
    assert found["slots_missed"] == 0


def test_two_messages_use_one_slot() -> None:
    twice = [*TWO_FRAMES[:3], sent(3, ("d", 384)), sent(3, ("d", 384), late_ms=64), *TWO_FRAMES[4:]]
    assert score_history(history(twice))["slots_used"] == 8


def test_slots_that_are_shared() -> None:
    """a and d are two hops apart, as are b and c: nobody shares within two hops; within one, two pairs do."""
    within = {
        reuse: slots_of(with_radio(history(), {"reuse": reuse})) for reuse in ("distance_two", "distance_one")
    }
    assert within["distance_two"] is not None
    assert within["distance_one"] is not None
    assert within["distance_two"].per_frame == 4
    assert within["distance_one"].per_frame == 2


def test_slots_of_a_given_length() -> None:
    slots = slots_of(with_radio(history(), {"units": None, "unit_bits": None, "slot_s": 0.2}))
    assert slots is not None
    assert (slots.slot_ns, slots.units) == (200 * MS, 3)
    guarded = slots_of(
        with_radio(history(), {"units": None, "unit_bits": None, "slot_s": 0.2, "guard_s": 0.01})
    )
    assert guarded is not None
    assert guarded.units == 2
    endless = slots_of(
        with_radio(history(), {"units": None, "unit_bits": None, "slot_s": 0.2}, bit_rate_bps=None)
    )
    assert endless is not None
    assert endless.units is None


def test_overhead_takes_room_in_a_slot_and_is_no_payload() -> None:
    given = {"units": None, "unit_bits": None, "slot_s": 0.2}  # 600 bits
    for overhead_bits, units in ((24, 3), (25, 2), (216, 2), (217, 1), (600, 0), (1000, 0)):
        slots = slots_of(with_radio(history(), given, overhead_bits=overhead_bits))
        assert slots is not None
        assert slots.units == units
    radio = [sent(0, ("a", 0), bits=192 + 16), sent(1, ("b", 128), ("a", 0), bits=384 + 16)]
    found = score_history(with_radio(history(radio), {}, overhead_bits=16))
    assert found["bytes_sent"] == 24 * 3
    assert found["per_robot"]["bytes_sent"] == {"a": 24, "b": 48, "c": 0, "d": 0}


def test_altitude_counts_in_slots_and_distances() -> None:
    """Robots above one another: 0, 6, 12, 18 m high and 10 m in range, at one place on the ground."""
    begin_ns, record = start([(1.0, 1.0)] * 4)
    for number, robot in enumerate(record["robots"]):
        robot["altitude_m"] = 6.0 * number
    above = history(truth=[(begin_ns, record)])
    shared = slots_of(with_radio(above, {"reuse": "distance_one"}))
    assert shared is not None
    assert shared.per_frame == 2
    assert places(above, [0.0])[0].tolist() == [[1.0, 1.0, 6.0 * number] for number in range(4)]
    found = score_history(above)
    assert [part["from_m"] for part in found["by_distance"]] == [5.0, 10.0, 15.0]
    assert list(found["by_hops"]) == ["1", "2", "3"]


def test_places_are_looked_at_once_a_second_and_more_rarely_in_long_runs() -> None:
    moving = moved(0, "a", 0.001, 0.0)
    assert instants_s(history(end_ms=10_000)).tolist() == [0.0]
    assert instants_s(covering(moving, end_ms=10_000)).tolist() == [float(second) for second in range(10)]
    assert instants_s(covering(moving, end_ms=500)).tolist() == [0.0]
    long = instants_s(covering(moving, end_ms=1_000_000_000))
    assert len(long) == MOST_DISTANCES // 16
    assert np.diff(long) == pytest.approx(1_000_000 / len(long))


def test_without_slots() -> None:
    found = score_history(with_radio(history(), {}, access="ideal"))
    assert found["slot_s"] is found["slots_used"] is found["slots_missed"] is None
    assert found["bytes_sent"] == 24 * 15


def test_a_score_is_json() -> None:
    assert orjson.dumps(score_history(history()))


# --- runs --------------------------------------------------------------------------------------------


def recorded(folder: Path, name: str, *overrides: str, seed: int = 1, robots: int | None = None) -> Path:
    scenario = load(name, robots=robots, seed=seed, overrides=list(overrides))
    out = folder / "run.mcap"
    run_scenario(scenario, Options(out=out, fleet="in_process", echo=None))
    return out


GRID = (
    "world.area_m=[90.0, 90.0]",
    "params.subgraphs=3x3",
    "radio.tdma.units=3",
)
HARSH = (
    *GRID, "run.stop.field=never", "run.duration_s=40.0", "radio.loss=0.2", "clock.drift_ppm=20.0", "clock.offset_s=0.5",
    "radio.tdma.order=drawn_each_frame", "radio.tdma.guard_s=0.002",
)  # fmt: skip


@pytest.mark.parametrize("overrides", [GRID, HARSH], ids=["calm", "harsh"])
def test_knowledge_is_what_robots_log(tmp_path: Path, overrides: Sequence[str]) -> None:
    """Rebuilt from the radio alone, it is in every slot the table that the robot says it has."""
    with LogReader(recorded(tmp_path, "dissemination", *overrides, robots=9)) as log:
        whole = read(log)
        entries = [entry for entry in log.records("/robot") if entry[1]["entry"] == "dissemination"]
    found = knowledge(whole.transmissions, 9)
    assert found.unexplained == 0
    assert len(entries) > 30
    for now_ns, entry in entries:
        own = whole.robots.index(entry["robot"])
        heard = (found.receiver == own) & (found.received_ns <= now_ns)
        stamps: list[int | None] = [None] * 9
        # Of each origin the last is the newest, and the last to be written.
        for origin, stamp in zip(found.origin[heard].tolist(), found.stamp_ms[heard].tolist(), strict=True):
            stamps[origin] = stamp
        stamps[own] = entry["data"]["stamps_ms"][own]
        assert entry["data"]["stamps_ms"] == stamps
    result = score_history(whole)
    assert 0 < result["slots_used"] <= len(entries)
    said = [(now_ns, len(entry["data"]["sent"])) for now_ns, entry in entries]
    # What is on the air as the run ends has never been sent.
    over = sum(count for now_ns, count in said if now_ns + count * SLOT_MS * MS // 2 <= whole.end_ns)
    assert result["estimates_sent"] == over


def test_ages_are_true_ages_when_clocks_are_wrong(tmp_path: Path) -> None:
    """Who hears the owner itself has an estimate as old as the packet is long, whatever the stamp says."""
    slow = (
        *GRID,
        "run.stop.field=never",
        "run.duration_s=40.0",
        "radio.tdma.guard_s=1.0",
        "clock.offset_s=0.5",
    )
    with LogReader(recorded(tmp_path, "dissemination", *slow, robots=9)) as log:
        found = knowledge(read(log).transmissions, 9)
    wrong_ns = found.stamp_ms * MS - found.made_ns
    assert -MS < wrong_ns.min() < wrong_ns.max() < 500 * MS
    assert wrong_ns.max() > 200 * MS
    direct = found.sent_ns == found.made_ns
    ages = set((found.received_ns - found.made_ns)[direct].tolist())
    assert ages <= {count * 64 * MS + LATENCY_NS for count in (1, 2, 3)}
    assert len(ages) > 1


def test_a_robot_that_leaves(tmp_path: Path) -> None:
    """Its slots are missed from then on."""
    shipped = (files("scenarios.dissemination") / "dissemination.toml").read_text()
    (tmp_path / "leaving.toml").write_text(
        shipped + '\n[[robot]]\nid = "r04"\nparams = { leaves_s = 20.0 }\n'
    )
    overrides = (*GRID, "run.stop.field=never", "run.duration_s=60.0")
    with LogReader(recorded(tmp_path, str(tmp_path / "leaving.toml"), *overrides, robots=9)) as log:
        whole = read(log)
    assert whole.ended_ns == [20_000 * MS if number == 4 else 60_000 * MS for number in range(9)]
    found = score_history(whole)
    frames = int(60 / (found["slot_s"] * 9))
    used = dict(found["per_robot"]["slots_used"])
    assert used.pop("r04") == pytest.approx(frames / 3, abs=1)
    assert set(used.values()) == {frames}
    assert found["slots_missed"] == 9 * frames - found["slots_used"]


def test_beta_stands_still_and_is_remote(tmp_path: Path) -> None:
    with LogReader(recorded(tmp_path, "dissemination-mixed", "run.duration_s=30.0")) as log:
        whole = read(log)
    found = received(whole)
    speeds = {robot["robot"]: any(robot["velocity_mps"]) for robot in whole.truth[0][1]["robots"]}
    assert not speeds[found["receiver"]]
    assert [robot["moves"] for robot in found["robots"]] == [
        speeds[robot["robot"]] for robot in found["robots"]
    ]
    assert sum(speeds.values()) == 5
    for robot in found["robots"]:
        assert all(stamp < when for stamp, when in zip(robot["stamp_s"], robot["received_s"], strict=True))
        assert robot["stamp_s"] == sorted(set(robot["stamp_s"]))
        assert robot["updates_per_minute"] == len(robot["stamp_s"]) * 2


def test_knowledge_of_who_joins_late_is_what_it_logs(tmp_path: Path) -> None:
    shipped = (files("scenarios.dissemination") / "dissemination.toml").read_text()
    (tmp_path / "late.toml").write_text(shipped + '\n[[robot]]\nid = "r04"\nparams = { joins_s = 7.0 }\n')
    overrides = (*GRID, "run.stop.field=never", "run.duration_s=12.0", "radio.tdma.order=fixed")
    with LogReader(recorded(tmp_path, str(tmp_path / "late.toml"), *overrides, robots=9)) as log:
        whole = read(log)
        entries = [entry for entry in log.records("/robot") if entry[1]["entry"] == "dissemination"]
    first_ns, first = next(entry for entry in entries if entry[1]["robot"] == "r04")
    assert 7e9 < first_ns < 9e9
    found = knowledge(whole.transmissions, 9)
    heard = (found.receiver == 4) & (found.received_ns <= first_ns)
    assert found.received_ns[found.receiver == 4].min() > 7e9
    told = {number for number, stamp in enumerate(first["data"]["stamps_ms"]) if stamp is not None}
    assert told == {4, *found.origin[heard].tolist()}


def standing(*x_m: float, **changed: Any) -> History:
    """Robots on a line, of which `changed` says otherwise."""
    begin_ns, record = start([(x, 5.0) for x in x_m])
    for robot in record["robots"]:
        robot["velocity_mps"] = changed.get(robot["robot"], [0.0, 0.0])
    motion = {"kind": "bounce", "speed_mps": 0.0}
    return replace(history(truth=[(begin_ns, record)]), settings=SETTINGS | {"world": {"motion": motion}})


def test_beta_is_the_farthest_from_all_of_those_that_stand() -> None:
    # Sums of distances 13, 11, 11, 27: it is not the one with the longest way to any other.
    found = received(standing(0.0, 1.0, 2.0, 10.0))
    assert found["receiver"] == "d"
    assert [robot["distance_m"] for robot in found["robots"]] == [10.0, 9.0, 8.0]
    assert received(standing(0.0, 1.0, 2.0, 10.0, d=[0.0, 0.1]))["receiver"] == "a"
    everybody = {name: [0.0, 0.1] for name in NAMES}
    assert received(standing(0.0, 1.0, 2.0, 10.0, **everybody))["receiver"] == "d"


def test_who_is_told_to_move_moves() -> None:
    begin = start([(0.0, 5.0), (1.0, 5.0), (2.0, 5.0), (10.0, 5.0)])
    settings = SETTINGS | {"world": {"motion": {"kind": "commanded", "max_speed_mps": 1.0}}}
    told = replace(history(truth=[begin, moved(500, "d", 0.0, 0.1)]), settings=settings)
    found = received(told)
    assert found["receiver"] == "a"
    assert [robot["moves"] for robot in found["robots"]] == [False, False, True]


def test_stamps_and_receptions_are_in_seconds() -> None:
    """The clock of d is five seconds ahead; a, which is beta, hears it from b."""
    radio = [sent(3, ("d", 5384), to="b"), sent(5, ("b", 640), ("d", 5384)), sent(7, ("d", 5896), to="")]
    found = received(history(radio))
    assert (found["receiver"], found["duration_s"]) == ("a", 1.024)
    of = {robot["robot"]: robot for robot in found["robots"]}
    assert of["d"]["stamp_s"] == [5.384]
    assert of["d"]["received_s"] == [0.7680001]
    assert of["d"]["updates_per_minute"] == pytest.approx(60 / 1.024)
    assert of["c"]["stamp_s"] == []


# --- coverage ----------------------------------------------------------------------------------------


def moved(at_ms: int, name: str, *velocity: float) -> Record:
    return at_ms * MS, {
        "kind": "motion", "robot": name, "velocity_mps": list(velocity), "towards_m": None, "speed_mps": 0.0,
    }  # fmt: skip


def covering(*truth: Record, end_ms: int = 50_000) -> History:
    settings = SETTINGS | {
        "world": {"motion": {"kind": "commanded", "max_speed_mps": 10.0}},
        "params": {"area_m": [20.0, 20.0]},
    }
    corners = start([(5.0, 5.0), (15.0, 5.0), (5.0, 15.0), (15.0, 15.0)])
    return replace(history(radio=(), end_ms=end_ms, truth=(corners, *truth)), settings=settings)


def test_coverage_by_hand() -> None:
    """Four robots in the middles of the quarters are as good as can be: 20^4 / 24."""
    found = coverage(covering())
    assert found["optimum"] == {"value": pytest.approx(20**4 / 24), "exact": True}
    assert found["cost_over_optimum"]["final"] == pytest.approx(1)
    assert found["mean_first_40_s"] == pytest.approx(1)


def test_coverage_follows_who_moves() -> None:
    """a drives to the right at 1 m/s for two seconds, and stays there; the same cost by adding up points."""
    found = coverage(covering(moved(1000, "a", 1.0, 0.0), moved(3000, "a", 0.0, 0.0)))["cost_over_optimum"]
    assert found["times_s"] == [float(time_s) for time_s in range(51)]
    points = np.stack(np.meshgrid(*[(np.arange(400) + 0.5) / 20] * 2), axis=-1).reshape(-1, 1, 2)
    for time_s, x in ((1, 5.0), (2, 6.0), (3, 7.0), (50, 7.0)):
        places = np.array([(x, 5.0), (15.0, 5.0), (5.0, 15.0), (15.0, 15.0)])
        nearest = ((points - places) ** 2).sum(axis=2).min(axis=1)
        assert found["per_time"][time_s] == pytest.approx(nearest.mean() * 400 / (20**4 / 24), rel=1e-4)
    assert found["final"] == found["per_time"][50]


def test_places_are_those_of_robots_that_were_told_where_to_go() -> None:
    """a makes for (8, 9) at 2.5 m/s, 5 m away, and stops there."""
    goes = 1000 * MS, {
        "kind": "motion", "robot": "a", "velocity_mps": [0.0, 0.0], "towards_m": [8.0, 9.0], "speed_mps": 2.5,
    }  # fmt: skip
    at = places(covering(goes), [0.0, 1.0, 2.0, 3.0, 10.0])[:, 0]
    assert at == pytest.approx(np.array([(5, 5, 0), (5, 5, 0), (6.5, 7, 0), (8, 9, 0), (8, 9, 0)]))


def test_places_are_those_of_robots_that_bounce() -> None:
    at = places(standing(1.0, 4.0, 7.0, 10.0, b=[0.5, 2.0]), [0.0, 1.0, 8.0])[:, 1, :2]
    assert at == pytest.approx(np.array([(4, 5), (4.5, 7), (8, 19)]))  # from 5 up by 16 and back from 20


def test_who_has_left_covers_nothing() -> None:
    left = replace(covering(), ended_ns=[20_000 * MS] * 3 + [50_000 * MS])
    costs = coverage(left)["cost_over_optimum"]["per_time"]
    assert costs[19] == pytest.approx(1)
    # One robot for all, in the middle of a quarter: 20^4 / 6 about the centre, and 50 m^2 for being beside it.
    assert costs[20] == costs[-1] == pytest.approx((20**4 / 6 + 50 * 400) / (20**4 / 24))
    nobody = coverage(replace(covering(), ended_ns=[20_000 * MS] * 4))
    assert nobody["cost_over_optimum"]["final"] is None
    assert nobody["mean_first_40_s"] is None


def test_coverage_of_a_run(tmp_path: Path) -> None:
    with LogReader(recorded(tmp_path, "coverage", "run.duration_s=10.0")) as log:
        found = score_coverage(log)
        whole = read(log)
    costs = found["coverage"]["cost_over_optimum"]
    starts = [(robot["position_m"][0], robot["position_m"][1]) for robot in whole.truth[0][1]["robots"]]
    assert costs["per_time"][0] == pytest.approx(cost(starts, (90.0, 90.0)) / (90**4 / 54))
    assert costs["final"] < costs["per_time"][0] / 3
    assert found["coverage"]["mean_first_40_s"] is None
    assert found["slots_missed"] == 0
    assert found["slots_used"] == 9 * int(10 / (9 * found["slot_s"]))


def test_a_log_that_does_not_say_what_was_run(tmp_path: Path) -> None:
    Recorder(tmp_path / "bare.mcap", NAMES).finish({})
    with (
        LogReader(tmp_path / "bare.mcap") as log,
        pytest.raises(ValueError, match="does not say what was run"),
    ):
        read(log)


def test_transmissions_are_read_by_number() -> None:
    one: Transmission = transmissions([sent(1, ("b", 128), ("a", 0), dropped={"loss": ["c"]})], NAMES)[0]
    assert one == Transmission(
        sender=1, start_ns=128 * MS, airtime_ns=128 * MS, slot=1, bits=384, refused=False,
        estimates=[(1, 128), (0, 0)], receivers=[0, 3], received_ns=[256 * MS + 100] * 2,
    )  # fmt: skip
