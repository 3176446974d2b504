"""The association behaviours on the emulator, all in this process."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

from emulator.errors import UserError
from emulator.scoring import score
from logs.reader import LogReader
from tests.support import run_scenario, write_scenario

SCENARIO = """
behaviour = "agent.behaviours.association.{behaviour}"
score = "scenarios.association.score:score"
robots = 14
[run]
duration_s = 30.0
stop = {{ entry = "association", field = "complete" }}
[world]
area_m = [30.0, 30.0]
[radio]
range_m = {radio}
[camera]
range_m = {camera}
[lamp]
colours = 4
[params]
step_s = 0.5
{params}
"""
P = "transmission_probability = 0.5\n"


def run(
    folder: Path, behaviour: str, params: str, *, radio: float = 14, camera: float = 14, more: str = ""
) -> Path:
    toml = SCENARIO.format(behaviour=behaviour, params=params, radio=radio, camera=camera) + more
    return run_scenario(write_scenario(folder, "", toml), folder / "log.mcap", "in_process").log


def entries(log: Path) -> dict[str, list[dict[str, Any]]]:
    """What each robot logged, in order."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    with LogReader(log) as reader:
        for _, record in reader.records("/robot"):
            assert record["entry"] == "association"
            found[record["robot"]].append(record["data"])
    return found


def radio(log: Path) -> list[dict[str, Any]]:
    with LogReader(log) as reader:
        return [record for _, record in reader.records("/radio")]


def lone_candidates(entry: dict[str, Any]) -> dict[str, str]:
    return {visual: names[0] for visual, names in entry["edges"].items() if len(names) == 1}


@pytest.mark.parametrize(
    ("behaviour", "params"),
    [
        ("stationary:associate", P),
        ("stationary:associate", P + "colours = 4"),
        ("naive:associate", "ids = 14"),
        ("logarithmic:associate", "ids = 14"),
    ],
)
def test_everything_in_sight_is_matched_and_right(behaviour: str, params: str, tmp_path: Path) -> None:
    log = run(tmp_path, behaviour, params)
    result = score(log)
    assert result["steps_to_completion"]["completed"] == result["robots"] == 14
    assert result["fraction_right"][-1] == 1.0
    assert result["ratio"][-1] == result["ratio_of_sums"][-1] == 1.0
    assert result["false_matches"] == 0
    for own in entries(log).values():
        assert list(own[0]) == ["step", "edges", "matches", "complete", "sent"]
        assert [entry["step"] for entry in own] == list(range(len(own)))
        assert all(entry["matches"] == lone_candidates(entry) for entry in own)
        assert own[0]["sent"]


def test_colours_are_faster(tmp_path: Path) -> None:
    means = []
    for colours in (1, 4):
        log = run(tmp_path, "stationary:associate", P + f"colours = {colours}")
        means.append(score(log)["steps_to_completion"]["mean"])
        log.unlink()
    assert means[1] < means[0] - 1


def test_a_coloured_pair_names_the_colour_it_shows(tmp_path: Path) -> None:
    log = run(tmp_path, "stationary:associate", P + "colours = 4")
    named = {record["payload"].get("colour") for record in radio(log)}
    assert named == {1, 2, 3, 4}


def test_deterministic_algorithms_use_the_radio_for_the_roll_call_only(tmp_path: Path) -> None:
    for behaviour, steps, flashes in (
        ("naive", 14, [1] * 14),
        ("logarithmic", 4, [n.bit_count() for n in range(14)]),
    ):
        log = run(tmp_path, f"{behaviour}:associate", "ids = 14")
        assert sorted(record["from"] for record in radio(log)) == [f"r{number:02d}" for number in range(14)]
        own = entries(log)
        assert {len(rows) for rows in own.values()} == {steps + 1}
        assert [sum(entry["sent"] for entry in own[name][1:]) for name in sorted(own)] == flashes
        result = score(log)
        assert set(result["steps_to_completion"]["per_robot"].values()) == {steps}
        assert result["messages_per_robot"] == 1.0
        assert result["flashes_sent"] == 14 + sum(flashes)
        log.unlink()


def test_sent_is_what_was_sent(tmp_path: Path) -> None:
    log = run(tmp_path, "stationary:associate", P)
    own = entries(log)
    for robot, rows in own.items():
        sent = [record["payload"] for record in radio(log) if record["from"] == robot]
        # The next step has begun when the run ends.
        assert len(sent) - sum(entry["sent"] for entry in rows) in (0, 1)


# --- who is in sight may not be heard ---------------------------------------------------------------


@pytest.mark.parametrize("colours", [1, 4])
def test_without_inclusion_lights_without_a_voice_match_nobody(colours: int, tmp_path: Path) -> None:
    params = P + f"channel_inclusion = false\nfalse_match_bound = 0.001\ncolours = {colours}"
    log = run(tmp_path, "stationary:associate", params, radio=9, camera=16)
    result = score(log)
    assert result["steps_to_completion"]["completed"] == 14
    assert result["false_matches_at_completion"] == 0
    assert 0.2 < result["fraction_matched"][-1] < 0.8
    for rows in entries(log).values():
        first = next(entry for entry in rows if entry["complete"])
        w = len({name for names in rows[0]["edges"].values() for name in names})
        c = 0.25 + 0.25 / colours
        assert w == 0 or w * len(rows[0]["edges"]) * c ** first["step"] <= 0.001 or not first["matches"]


def test_nothing_in_common_is_a_result(tmp_path: Path) -> None:
    """Nobody is heard, everybody is seen."""
    log = run(tmp_path, "stationary:associate", P + "channel_inclusion = false", radio=0.1, camera=50)
    result = score(log)
    assert set(result["steps_to_completion"]["per_robot"].values()) == {0}
    assert result["fraction_matched"] == [0.0]
    assert result["ratio"] == [None]
    assert entries(log)["r00"][0]["matches"] == {}


def test_with_inclusion_taken_for_granted_a_light_without_a_voice_is_never_done(tmp_path: Path) -> None:
    result = score(run(tmp_path, "stationary:associate", P, radio=9, camera=16))
    assert result["steps_to_completion"]["completed"] < 14


@pytest.mark.parametrize("behaviour", ["naive:associate", "logarithmic:associate"])
def test_lights_whose_number_nobody_announced(behaviour: str, tmp_path: Path) -> None:
    log = run(tmp_path, behaviour, "ids = 14", radio=9, camera=16)
    result = score(log)
    assert result["steps_to_completion"]["completed"] == 14
    assert result["false_matches_at_completion"] == 0
    assert result["ratio"][-1] == 1.0
    assert 0.2 < result["fraction_matched"][-1] < 0.8


# --- beacons, and robots that move ---------------------------------------------------------------------

OBSERVER = """
[[robot]]
id = "r03"
behaviour = "agent.behaviours.association.{}:associate"
"""


def test_one_observer_among_beacons(tmp_path: Path) -> None:
    log = run(tmp_path, "stationary:beacon", P, more=OBSERVER.format("stationary"), radio=50, camera=50)
    result = score(log)
    assert result["robots"] == result["steps_to_completion"]["completed"] == 1
    assert result["fraction_right"][-1] == 1.0
    assert list(entries(log)) == ["r03"]
    sent = [record["from"] for record in radio(log)]
    assert sent[:14] == [f"r{number:02d}" for number in range(14)]  # the roll call
    assert result["messages_per_robot"] == len(sent) / 14 > 20


def test_beacons_without_a_roll_call(tmp_path: Path) -> None:
    log = run(
        tmp_path, "stationary:beacon", P + "roll_call = false\ndrop_time = 20", more=OBSERVER.format("mobile")
    )
    with LogReader(log) as reader:
        first = [record["from"] for time_ns, record in reader.records("/radio") if time_ns == 0]
    assert 0 < len(first) < 14
    (rows,) = entries(log).values()
    assert [entry["step"] for entry in rows] == list(range(1, 61))
    assert not any(entry["complete"] for entry in rows)
    assert all(entry["matches"] == lone_candidates(entry) for entry in rows)
    # Stationary robots: one that is matched stays so, until its voice is silent for 20 steps.
    assert len(rows[-1]["matches"]) == len(rows[-1]["edges"]) > 3
    assert score(log)["fraction_right"][-1] == 1.0


def test_steps_without_a_frame_are_left_out(tmp_path: Path) -> None:
    """A frame every other step: what was spoken meanwhile contradicts no light."""
    toml = SCENARIO.format(behaviour="stationary:associate", params=P, radio=14, camera=14)
    toml = toml.replace("[camera]\n", "[camera]\nframe_rate_hz = 1.0\nphase_s = 0.25\n")
    log = run_scenario(write_scenario(tmp_path, "", toml), tmp_path / "log.mcap", "in_process").log
    result = score(log)
    assert result["steps_to_completion"]["completed"] == 14
    assert result["fraction_right"][-1] == 1.0


def test_among_moving_robots_a_step_without_a_frame_changes_nothing(tmp_path: Path) -> None:
    """A frame in the odd steps: nobody has left view because nobody looked."""
    toml = SCENARIO.format(behaviour="mobile:associate", params=P, radio=14, camera=14)
    toml = toml.replace("[camera]\n", "[camera]\nframe_rate_hz = 1.0\nphase_s = 0.25\n")
    toml = toml.replace("[radio]\n", 'motion = { kind = "bounce", speed_mps = 0.2 }\n[radio]\n')
    log = run_scenario(write_scenario(tmp_path, "", toml), tmp_path / "log.mcap", "in_process").log
    own = entries(log)
    assert len(own) == 14
    candidates = 0
    for rows in own.values():
        assert [entry["step"] for entry in rows] == list(range(1, 61))
        for looked, blind in zip(rows[::2], rows[1::2], strict=True):
            assert (blind["edges"], blind["matches"]) == (looked["edges"], looked["matches"])
            candidates += len(looked["edges"])
    assert candidates > 14 * 30  # or this would say little
    assert score(log)["fraction_right"][-1] > 0.5


# --- mistakes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("behaviour", "params", "sentence"),
    [
        ("stationary:associate", "", "params.transmission_probability: is missing; write a number from 0 to 1"),
        ("stationary:associate", "transmission_probability = 1.5", "params.transmission_probability: must be a number from 0 to 1, is 1.5"),
        ("stationary:associate", P + "colours = 5", "params.colours: is 5, but lamps show 4; set lamp.colours to 5 as well"),
        ("stationary:associate", P + "colours = 0", "params.colours: must be a whole number, 1 or more, is 0"),
        ("stationary:associate", P + "channel_inclusion = 1", "params.channel_inclusion: must be true or false, is 1"),
        ("stationary:associate", P + "false_match_bound = -1", "params.false_match_bound: must be a number from 0 to 1, is -1"),
        ("stationary:beacon", P + 'roll_call = "no"', "params.roll_call: must be true or false, is 'no'"),
        ("mobile:associate", P + "colours = 2", "params.colours: is 2, but among moving robots lights are on or off; set it to 1"),
        ("mobile:associate", P + "drop_time = 0", "params.drop_time: must be a whole number, 1 or more, is 0"),
        ("naive:associate", "", "params.ids: is missing; write a whole number, 1 or more"),
        ("naive:associate", "ids = 13", "params.number: r13 has number 13, but params.ids = 13 allows 0 to 12; raise ids, or"),
        ("logarithmic:associate", "ids = 14.0", "params.ids: must be a whole number, 1 or more, is 14.0"),
    ],
)  # fmt: skip
def test_params_that_do_not_do(behaviour: str, params: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(UserError) as failed:
        run(tmp_path, behaviour, params)
    assert f"mine: {sentence}" in str(failed.value)


@pytest.mark.parametrize("step_s", ["0.0", "-1", "true"])
def test_steps_that_do_not_last(step_s: str, tmp_path: Path) -> None:
    toml = SCENARIO.format(behaviour="stationary:associate", params=P, radio=14, camera=14)
    path = write_scenario(tmp_path, "", toml.replace("step_s = 0.5", f"step_s = {step_s}"))
    with pytest.raises(UserError, match="must be a number greater than 0"):
        run_scenario(path, tmp_path / "log.mcap", "in_process")


def test_two_robots_of_one_number(tmp_path: Path) -> None:
    twin = '[[robot]]\nid = "r05"\nparams = { number = 3 }\n'
    with pytest.raises(
        UserError, match="r03 and r05 both have number 3; give each robot a number of its own"
    ):
        run(tmp_path, "naive:associate", "ids = 14", more=twin, radio=50)


def test_numbers_of_robots_with_names(tmp_path: Path) -> None:
    toml = SCENARIO.format(behaviour="logarithmic:associate", params="ids = 8", radio=50, camera=50)
    toml = toml.replace("robots = 14", 'robots = ["ann", "bob", "r2"]')
    toml += '[[robot]]\nid = "ann"\nparams = { number = 7 }\n[[robot]]\nid = "bob"\nparams = { number = 0 }\n'
    log = run_scenario(write_scenario(tmp_path, "", toml), tmp_path / "log.mcap", "in_process").log
    result = score(log)
    assert result["fraction_right"][-1] == 1.0
    assert result["steps_to_completion"]["per_robot"] == {"ann": 3, "bob": 3, "r2": 3}


FARTHER = """
behaviour = "agent.behaviours.association.stationary:beacon"
score = "scenarios.association.score_mobile:score"
robots = 60
[run]
duration_s = 30.0
[world]
area_m = [40.0, 40.0]
placement = "jittered_grid"
motion = {{ kind = "bounce", speed_mps = 0.0 }}
[[group]]
name = "mobile"
robots = 6
behaviour = "agent.behaviours.association.mobile:associate"
placement = "uniform"
speed_mps = 1.0
[radio]
range_m = 14.0
[lamp]
latency_s = 0.00001
[camera]
range_m = 7.0
phase_s = 0.00002
[params]
step_s = 0.5
transmission_probability = 0.5
roll_call = false
wireless_exceeds_visual = {}
"""


def test_a_radio_that_reaches_farther_than_the_camera(tmp_path: Path) -> None:
    """Whoever comes into view has been heard before: only robots that know of it can match it."""
    right = {}
    for told in ("true", "false"):
        path = write_scenario(tmp_path, "", FARTHER.format(told), told)
        log = run_scenario(path, tmp_path / f"{told}.mcap", "in_process").log
        right[told] = score(log)["all"]["fraction_right"]["mean"]
    assert right["true"] > 0.7
    assert right["false"] < 0.3
