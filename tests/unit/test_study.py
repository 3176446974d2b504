"""Studies: chunks, seeds, processes, errors; and parameters as users type them."""

from __future__ import annotations

import contextlib
import math
import multiprocessing.resource_tracker
import multiprocessing.util
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import pytest
from msgspec import Meta, Struct

from emulator.errors import RunFailed, UserError
from scenarios import catalogue
from scenarios.catalogue import find
from scenarios.parameters import assignments, explained, parameters_from
from scenarios.study import Study, Workers, error_of_sums, generator, mean_and_error, run_study


class Dice(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    sides: Annotated[int, Meta(ge=2, le=100, description="faces of a die")] = 6
    bias: Annotated[float, Meta(ge=0, le=1, description="weight of the one")] | None = None
    cheating: Annotated[float, Meta(ge=0, lt=1, description="may it be loaded")] = 0.0
    table: Annotated[str | None, Meta(description="what it is thrown on")] = None


class Needy(Struct, frozen=True, kw_only=True):
    wireless: Annotated[int, Meta(ge=1)]


def simulate(dice: Dice, rng: np.random.Generator, samples: int) -> list[int]:
    return rng.integers(1, dice.sides + 1, samples).tolist()


def die(_dice: Dice, _rng: np.random.Generator, _samples: int) -> list[int]:
    os._exit(9)


def fail(_dice: Dice, _rng: np.random.Generator, _samples: int) -> list[int]:
    raise ZeroDivisionError("a bug")


def summarise(_dice: Dice, partials: list[list[int]]) -> dict[str, Any]:
    rolled = [roll for partial in partials for roll in partial]
    return {"rolled": rolled, "chunks": [len(partial) for partial in partials]}


def seven(_dice: Dice) -> int:
    return 7


def check(dice: Dice) -> None:
    if dice.sides == 13:
        raise ValueError("sides: 13 brings bad luck; take 12")


STUDY = Study("dice", "Dice", Dice, 100, "rolls", seven, simulate, summarise, check)


def test_a_study_is_cut_into_chunks_of_one_size() -> None:
    result = run_study(STUDY, Dice(), samples=17, jobs=1)
    assert result["chunks"] == [7, 7, 3]
    assert len(run_study(STUDY, Dice(), jobs=1)["rolled"]) == 100


def test_every_chunk_has_a_generator_of_its_own() -> None:
    rolled = run_study(STUDY, Dice(), samples=14, seed=4, jobs=1)["rolled"]
    assert rolled == [
        *simulate(Dice(), generator("dice", 4, 0), 7),
        *simulate(Dice(), generator("dice", 4, 1), 7),
    ]
    draws = {generator(name, seed, chunk).integers(2**63).item()
             for name in ("dice", "cards") for seed in (1, 2) for chunk in (0, 1)}  # fmt: skip
    assert len(draws) == 8


def test_more_samples_begin_with_the_fewer() -> None:
    few, many = (run_study(STUDY, Dice(), samples=n, jobs=1)["rolled"] for n in (14, 28))
    assert many[:14] == few


@pytest.mark.parametrize("jobs", [2, 3])
def test_the_result_does_not_depend_on_how_many_work(jobs: int) -> None:
    alone = run_study(STUDY, Dice(), samples=50, seed=3, jobs=1)
    assert run_study(STUDY, Dice(), samples=50, seed=3, jobs=jobs) == alone
    assert run_study(STUDY, Dice(), samples=50, seed=4, jobs=1) != alone


def test_workers_do_one_study_after_the_other() -> None:
    with Workers(2) as workers:
        first = run_study(STUDY, Dice(), samples=20, workers=workers)
        second = run_study(STUDY, Dice(sides=20), samples=20, workers=workers)
    assert first == run_study(STUDY, Dice(), samples=20, jobs=1)
    assert second == run_study(STUDY, Dice(sides=20), samples=20, jobs=1)


def test_progress_is_told() -> None:
    told: list[int] = []
    run_study(STUDY, Dice(), samples=17, jobs=1, on_progress=told.append)
    assert told == [7, 14, 17]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="sides: 13 brings bad luck; take 12"):
        run_study(STUDY, Dice(sides=13), jobs=1)
    with pytest.raises(ValueError, match="samples: a study takes at least 1 and at most 10000000000, not 0"):
        run_study(STUDY, Dice(), samples=0)
    with pytest.raises(ValueError, match="jobs: 1 to 256 processes can work, not 0"):
        run_study(STUDY, Dice(), jobs=0)


def test_a_worker_that_dies_ends_the_study() -> None:
    deadly = msgspec.structs.replace(STUDY, simulate=die)
    with pytest.raises(RunFailed, match="was killed"):
        run_study(deadly, Dice(), samples=30, jobs=2)


def test_an_interrupt_between_a_worker_s_birth_and_its_orders_waits(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*args: object) -> int:
        born.append(spawn(*args))
        signal.raise_signal(signal.SIGINT)
        return born[-1]

    multiprocessing.resource_tracker.ensure_running()  # a helper of the library's, started the same way
    born: list[int] = []
    spawn = multiprocessing.util.spawnv_passfds  # type: ignore[attr-defined]
    monkeypatch.setattr(multiprocessing.util, "spawnv_passfds", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(STUDY, Dice(), samples=30, jobs=2)
    for pid in born:
        with contextlib.suppress(ChildProcessError):  # the pool has waited for it
            os.waitpid(pid, 0)
    assert capfd.readouterr().err == ""  # no traceback of a worker that finds its pipe closed
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_in_a_chunk_is_passed_on(jobs: int) -> None:
    with pytest.raises(ZeroDivisionError, match="a bug"):
        run_study(msgspec.structs.replace(STUDY, simulate=fail), Dice(), samples=30, jobs=jobs)


def test_mean_and_error_by_hand() -> None:
    assert mean_and_error([1.0, 2.0, 3.0]) == (2.0, pytest.approx(math.sqrt(1 / 3)))
    assert mean_and_error([4.0]) == (4.0, None)


def test_error_of_sums_by_hand() -> None:
    values = [1, 2, 3, 6]
    square = sum(value * value for value in values)
    assert error_of_sums(4, 12, square, 2) == pytest.approx(mean_and_error([0.5, 1, 1.5, 3])[1])
    assert error_of_sums(1, 12, square) is None


# --- parameters ----------------------------------------------------------------------------------


def test_parameters_from_text() -> None:
    assert parameters_from(Dice, {}, "--set ") == Dice()
    assert parameters_from(Dice, {"sides": "20", "bias": "1"}, "--set ") == Dice(sides=20, bias=1.0)
    assert assignments(["sides=20", " bias = 0.5"]) == {"sides": "20", "bias": "0.5"}


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        ({"side": "6"}, "--set unknown key side, did you mean sides?"),
        ({"sides": "1"}, "--set sides: must be a whole number from 2 to 100, is 1"),
        (
            {"sides": "six"},
            '--set sides: must be a whole number from 2 to 100, is "six"; write the bare number',
        ),
        ({"sides": "2.5"}, "--set sides: must be a whole number from 2 to 100, is 2.5"),
        ({"bias": "nan"}, "--set bias: must be a number from 0 to 1, is nan"),
        ({"bias": "-0.1"}, "--set bias: must be a number from 0 to 1, is -0.1"),
        ({"cheating": "1"}, "--set cheating: must be a number of at least 0 and less than 1, is 1"),
        ({"table": "3"}, "--set table: must be a text in quotes, is 3"),
    ],
)
def test_parameters_that_do_not_fit(texts: dict[str, str], sentence: str) -> None:
    with pytest.raises(UserError) as raised:
        parameters_from(Dice, texts, "--set ")
    assert str(raised.value) == sentence


def test_a_parameter_that_is_needed() -> None:
    with pytest.raises(UserError, match="--wireless is missing: must be a whole number of at least 1"):
        parameters_from(Needy, {}, "--")


def test_what_sets_nothing() -> None:
    with pytest.raises(UserError, match="--set sides: sets nothing; write key=value"):
        assignments(["sides"])


def test_parameters_are_explained() -> None:
    assert explained(Dice) == [
        ("sides", "6", "faces of a die"), ("bias", "not set", "weight of the one"),
        ("cheating", "0.0", "may it be loaded"), ("table", "not set", "what it is thrown on"),
    ]  # fmt: skip


# --- the catalogue -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["PREDICTIONS", "STUDIES", "PAPERS"])
def test_the_catalogue_holds_what_it_names(kind: str) -> None:
    listed: dict[str, str] = getattr(catalogue, kind)
    for name in listed:
        assert find("thing", listed, name).name == name


@pytest.mark.parametrize("kind", ["PREDICTIONS", "STUDIES"])
def test_every_parameter_is_described(kind: str) -> None:
    listed: dict[str, str] = getattr(catalogue, kind)
    for name in listed:
        for key, _, description in explained(find("thing", listed, name).parameters):
            assert description, f"{name}: {key}"


def test_an_unknown_name() -> None:
    with pytest.raises(
        UserError, match="assocation: there is no study of this name, did you mean association"
    ):
        find("study", catalogue.STUDIES, "assocation")


def test_a_missing_package_is_named(tmp_path: Path) -> None:
    (tmp_path / "scipy.py").write_text("raise ModuleNotFoundError('no scipy', name='scipy')")
    code = "from scenarios.catalogue import STUDIES, find; find('study', STUDIES, 'association-mobile')"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": f"{tmp_path}:{Path.cwd()}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "association-mobile: needs scipy; install heliograph[desk,figures]" in done.stderr


def test_running_a_scenario_waits_for_no_heavy_package() -> None:
    code = (
        "import sys, emulator.cli; emulator.cli._parser(); print({'scipy', 'matplotlib'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
