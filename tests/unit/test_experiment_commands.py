"""`heliograph predict`, `study` and `reproduce`, as typed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from emulator.cli import main


@pytest.fixture
def heliograph(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*words: object) -> tuple[int, str, str]:
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def result(answer: tuple[int, str, str]) -> dict[str, Any]:
    code, out, err = answer
    assert (code, err) == (0, "")
    decoded: dict[str, Any] = json.loads(out)
    return decoded


# --- predict -------------------------------------------------------------------------------------


def test_predict_association(heliograph: Any) -> None:
    found = result(heliograph("predict", "association", "--wireless", 4, "--visual", 3, "--json"))
    assert found["expected_steps"] == pytest.approx(88 / 21, abs=1e-9)
    assert found["cdf"][:3] == [0.0, 0.0, pytest.approx(3 / 32)]
    assert found["fraction_matched"][1] == pytest.approx(1 / 8)
    assert found["branching_process"] == pytest.approx(3.1699250014)
    assert {"sd", "fits"} <= found.keys()


def test_predict_association_with_another_probability(heliograph: Any) -> None:
    slow = result(heliograph("predict", "association", "--wireless=20", "--visual=10", "--p=0.2", "--json"))
    fast = result(heliograph("predict", "association", "--wireless=20", "--visual=10", "--json"))
    assert slow["expected_steps"] > fast["expected_steps"]


def test_predict_mobile(heliograph: Any) -> None:
    words = ("--range", 16, "--speed", 1.4, "--separation", 4, "--json")
    found = result(heliograph("predict", "association-mobile", *words))
    for reading in ("literal", "corrected"):
        assert 0 < found[reading]["fraction_matched"] < 1
        assert found[reading]["ratio"]["two_region"] > 1
        assert found[reading]["ratio"]["multi_region"] > 1
    assert found["literal"]["ratio"]["two_region"] > found["corrected"]["ratio"]["two_region"]


def test_what_can_be_predicted_is_listed(heliograph: Any) -> None:
    code, out, _ = heliograph("predict")
    assert code == 0
    assert "association-mobile" in out
    assert "--wireless" in out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["predict", "asociation"], "asociation: there is no prediction of this name, did you mean association?"),
        (["predict", "association", "--wireless", "4"], "--visual is missing"),
        (["predict", "association", "--wireless", "x", "--visual", "3"], "--wireless: must be a whole number"),
        (["predict", "association", "--wireless", "4", "--visual", "5"], "association: visual: 5 visual ids"),
        (["predict", "association", "--wireless", "4", "--visual", "3", "--p", "0"], "association: p: "),
        (["predict", "association-mobile", "--speed", "0.001"], "association-mobile: speed: 0.001 is too slow"),
        (["study", "assoc"], "assoc: there is no study of this name, did you mean association?"),
        (["study", "association", "--set", "wireles=3"], "--set unknown key wireles, did you mean wireless?"),
        (["study", "association", "--set", "visual=21"], "association: visual: "),
        (["study", "association-mobile", "--set", "wireless_range=3"], "association-mobile: wireless_range: "),
        (["study", "association-noisy", "--set", "wireless_loss=2"], "--set wireless_loss: must be a number"),
        (["reproduce", "ivanov"], "ivanov: there is no paper of this name"),
        (["reproduce", "ivanov-shell-2014", "--figure", "5"], "can be drawn in its figures 3, 4"),
    ],
)  # fmt: skip
def test_mistakes_are_one_sentence(heliograph: Any, words: list[str], sentence: str) -> None:
    code, out, err = heliograph(*words)
    assert (code, out) == (2, "")
    assert err.startswith("heliograph: ")
    assert err.count("\n") == 1
    assert sentence in err


# --- study ---------------------------------------------------------------------------------------


def test_study_association(heliograph: Any) -> None:
    words = (
        "study",
        "association",
        "--set",
        "wireless=4",
        "--set",
        "visual=3",
        "--samples",
        20_000,
        "--json",
    )
    found = result(heliograph(*words, "--jobs", 1))
    assert abs(found["steps"]["mean"] - 88 / 21) < 4 * found["steps"]["se"]
    mean, error = found["fraction_matched"][1]
    assert abs(mean - 1 / 8) < 4 * error
    assert found["samples"] == 20_000
    assert result(heliograph(*words, "--jobs", 2)) == found
    assert result(heliograph(*words, "--jobs", 1, "--seed", 2)) != found


def test_study_mobile(heliograph: Any) -> None:
    words = ("study", "association-mobile", "--set", "world=60", "--set", "range=8", "--set", "steps=10")
    found = result(heliograph(*words, "--samples", 3, "--jobs", 1, "--json"))
    for where in ("deep", "all"):
        assert {"fraction_matched", "ratio", "ratio_of_sums", "visual_ids_in_list"} <= found[where].keys()
        assert {"mean", "sd", "se"} == found[where]["ratio"].keys()
    assert result(heliograph(*words, "--samples", 3, "--jobs", 2, "--json")) == found


def test_study_noisy(heliograph: Any) -> None:
    words = ("study", "association-noisy", "--set", "wireless=6", "--set", "visual=3", "--set", "steps=20")
    found = result(heliograph(*words, "--samples", 400, "--jobs", 1, "--json"))
    assert len(found["p_all_right"]) == len(found["fraction_right"]) == 21
    assert found["p_all_right"][0] < 0.5 < found["p_all_right"][-1]
    assert result(heliograph(*words, "--samples", 400, "--jobs", 2, "--json")) == found


@pytest.mark.parametrize(
    ("option", "bound"), [("--samples", "from 1 to 10000000000"), ("--jobs", "from 1 to 256")]
)
@pytest.mark.parametrize("number", ["0", "100000000000000000000", "x"])
def test_counts_out_of_bounds(
    capsys: pytest.CaptureFixture[str], option: str, bound: str, number: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["study", "association", option, number])
    assert ended.value.code == 2
    assert f"argument {option}: is a whole number {bound}, not '{number}'" in capsys.readouterr().err


def test_a_study_for_people(heliograph: Any) -> None:
    code, out, _ = heliograph("study", "association", "--samples", 500, "--jobs", 1)
    assert code == 0
    assert out.splitlines()[0].startswith("steps ")


def test_studies_are_listed(heliograph: Any) -> None:
    _, out, _ = heliograph("study")
    assert out.index("association:") < out.index("association-mobile:") < out.index("association-noisy:")
    assert "wireless_loss" in out


# --- reproduce -----------------------------------------------------------------------------------


def test_reproduce_one_figure(heliograph: Any, tmp_path: Path) -> None:
    words = ("reproduce", "ivanov-shell-2016", "--figure", 7, "--samples", 400, "--out", tmp_path, "--json")
    code, out, _ = heliograph(*words)
    assert code == 0
    assert json.loads(out) == [str(tmp_path / f"figure-07.{kind}") for kind in ("png", "svg", "csv")]
    header, *rows = (tmp_path / "figure-07.csv").read_text().splitlines()
    assert header.startswith("wireless,visual,mean,se,sd")
    assert len(rows) == 10
    code, _, err = heliograph(*words)
    assert code == 2
    assert "figure-07.png exists; choose another --out or say --force" in err


def test_papers_are_listed(heliograph: Any) -> None:
    _, out, _ = heliograph("reproduce")
    for number in (5, 9, 10, 17, 20, 25):
        assert f"--figure {number} " in out
