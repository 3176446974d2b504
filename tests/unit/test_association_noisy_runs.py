"""The noise-tolerant behaviour on the emulator, and how its claims are scored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from emulator.errors import UserError
from emulator.scoring import score
from logs.reader import LogReader
from scenarios.association.score_noisy import calibration, first_claims, last_rates
from tests.support import run_scenario, write_scenario

SCENARIO = """
behaviour = "agent.behaviours.association.noisy:associate"
score = "scenarios.association.score_noisy:score"
robots = 10
[run]
duration_s = 40.0
stop = {{ entry = "association", field = "complete" }}
[world]
area_m = [24.0, 24.0]
[radio]
range_m = {radio}
loss = 0.2
[camera]
range_m = 14.0
miss = 0.1
lamp_miss = 0.1
lamp_false = 0.05
[lamp]
colours = 2
[params]
step_s = 0.5
transmission_probability = 0.5
{params}
"""
KNOWN = "wireless_loss = 0.2\nvisual_miss = 0.1\nvisual_false = 0.05\n"


def run(folder: Path, params: str, radio: float = 14.0) -> Path:
    path = write_scenario(folder, "", SCENARIO.format(params=params, radio=radio))
    return run_scenario(path, folder / "log.mcap", "in_process").log


def entries(log: Path) -> list[tuple[str, dict[str, Any]]]:
    with LogReader(log) as reader:
        return [(record["robot"], record["data"]) for _, record in reader.records("/robot")]


@pytest.mark.parametrize("params", [KNOWN, "", KNOWN + "estimate_rates = true"])
def test_all_in_sight_is_claimed_and_nearly_all_right(params: str, tmp_path: Path) -> None:
    log = run(tmp_path, params)
    result = score(log)
    assert result["steps_to_completion"]["completed"] == 10
    assert result["false_matches_at_completion"] <= 1
    first = result["first_claims"]
    assert sum(row["claims"] for row in first) >= 40
    assert sum(row["claims"] - row["right"] for row in first) <= 3
    assert (result["rates"]["wireless_loss"] == 0.2) == (params == KNOWN)
    assert result["rates"]["wireless_loss"] == pytest.approx(0.2, abs=0.08)
    keys = ["step", "edges", "matches", "posteriors", "strangers", "rates", "complete", "sent"]
    for _, entry in entries(log):
        assert list(entry) == keys
        assert entry["posteriors"].keys() == entry["matches"].keys()
        assert all(0.99 <= value <= 1 for value in entry["posteriors"].values())
        assert all(name in entry["edges"][visual] for visual, name in entry["matches"].items())
        assert entry["complete"] == (len(entry["matches"]) == len(entry["edges"]))
        assert entry["strangers"] == []


def test_lights_out_of_radio_range_are_strangers(tmp_path: Path) -> None:
    log = run(tmp_path, KNOWN + "nobody = 0.4", radio=8.0)
    assert score(log)["steps_to_completion"]["completed"] == 10
    last = dict(entries(log))
    strangers = sum(len(entry["strangers"]) for entry in last.values())
    assert strangers > 15
    assert sum(len(entry["matches"]) for entry in last.values()) > 10
    with LogReader(log) as reader:
        truth = [record for _, record in reader.records("/truth")]
        heard = {
            (receiver, record["from"])
            for _, record in reader.records("/radio")
            for receiver in [*record["delivered"], *record["dropped"]]
            if record["dropped"].get(receiver) != "out_of_range"
        }
    owner = {
        (seen["observer"], seen["visual"]): seen["robot"]
        for record in truth
        if record["kind"] == "visual ids"
        for seen in record["entered"]
    }
    wrong = sum(
        (robot, owner[robot, visual]) in heard
        for robot, entry in last.items()
        for visual in entry["strangers"]
    )
    assert wrong <= 2


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ("confidence = 0.5", "params.confidence: must be above 0.5, is 0.5"),
        ("colours = 2", "params.colours: association under noise tells lit from dark only"),
        ("wireless_loss = 2", "params.wireless_loss: must be a number from 0 to 1, is 2"),
        ('visual_miss = "much"', "params.visual_miss: must be a number from 0 to 1"),
        ('wireless_false = "estimate"', "params.wireless_false: not all four rates can be estimated"),
        ("nobody = 1", "params.nobody: a probability below 1"),
        (
            "wireless_loss = 0.0\nestimate_rates = true",
            "params.wireless_loss: a rate to be estimated begins between 0 and 1",
        ),
    ],
)
def test_mistakes_are_told_in_one_sentence(params: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(UserError) as failure:
        run(tmp_path, params)
    assert sentence in str(failure.value)


# --- the score, on made-up histories -----------------------------------------------------------------


TRUTH = {("a", 1): "b", ("a", 2): "c"}


def entry(matches: dict[str, str], posteriors: dict[str, float], loss: float) -> tuple[str, dict[str, Any]]:
    return "a", {"matches": matches, "posteriors": posteriors, "rates": {"wireless_loss": loss}}


HISTORY = [
    entry({"1": "c"}, {"1": 0.991}, 0.1),
    entry({}, {}, 0.2),
    entry({"1": "b", "2": "c"}, {"1": 0.995, "2": 0.999}, 0.3),
    entry({"1": "b", "2": "c"}, {"1": 1.0, "2": 0.9999}, 0.4),
]


def test_calibration_by_hand() -> None:
    rows = calibration(HISTORY, TRUTH)
    assert [(row["from"], row["to"], row["claims"], row["right"]) for row in rows] == [
        (0.99, 0.999, 2, 1),
        (0.999, 0.9999, 1, 1),
        (0.9999, 1.0, 2, 2),
    ]
    assert rows[0]["expected_right"] == pytest.approx(1.986)


def test_first_claims_are_counted_once() -> None:
    rows = calibration(first_claims(HISTORY), TRUTH)
    assert [(row["from"], row["claims"], row["right"]) for row in rows] == [(0.99, 1, 0), (0.999, 1, 1)]


def test_rates_at_the_end() -> None:
    other = ("b", HISTORY[1][1])
    assert last_rates([*HISTORY, other]) == {"wireless_loss": pytest.approx(0.3)}
    assert last_rates([]) == {}
    assert calibration([], TRUTH) == []
