"""The commands that belong to experiments: `heliograph predict`, `study` and `reproduce`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from msgspec import Struct
from tqdm import tqdm

from emulator.arguments import Commands, add_command, add_json, print_json
from emulator.errors import UserError
from emulator.table import score_table
from scenarios.catalogue import PAPERS, PREDICTIONS, STUDIES, find
from scenarios.parameters import assignments, explained, parameters_from
from scenarios.prediction import Prediction
from scenarios.study import MOST_JOBS, MOST_SAMPLES, Study, run_study

OK = 0


def add_commands(commands: Commands) -> None:
    """Add the experiments' commands to those of the emulator."""
    predict = add_command(commands, "predict", _predict, "what theory says of an experiment")
    predict.add_argument("name", nargs="?", metavar="NAME", help="an experiment; without one, lists them")
    predict.add_argument("options", nargs=argparse.REMAINDER, metavar="--PARAMETER VALUE",
                         help="parameters of the theory, and --json")  # fmt: skip

    study = add_command(commands, "study", _study, "large samples of an experiment by vectorised Monte Carlo")
    study.add_argument("name", nargs="?", metavar="NAME", help="a study; without one, lists them")
    study.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                       help="set one parameter, as wireless=20")  # fmt: skip
    _add_work(study)
    add_json(study)

    reproduce = add_command(commands, "reproduce", _reproduce, "draw the figures of a paper anew")
    reproduce.add_argument("name", nargs="?", metavar="PAPER", help="a paper; without one, lists them")
    reproduce.add_argument("--figure", type=_figure, action="append", metavar="N",
                           help="only this figure; may be given more than once")  # fmt: skip
    _add_work(reproduce)
    reproduce.add_argument("--out", type=Path, metavar="FOLDER", help="default: figures/PAPER")
    reproduce.add_argument("--force", action="store_true", help="overwrite existing files")
    add_json(reproduce)


def _add_work(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--samples", type=_count(MOST_SAMPLES), metavar="N",
                        help="how many samples (default: its own)")  # fmt: skip
    parser.add_argument("--jobs", type=_count(MOST_JOBS), metavar="J",
                        help="processes that share the work (default: one per processor)")  # fmt: skip
    parser.add_argument("--seed", type=_seed, default=1, metavar="S", help="seed of all randomness (1)")


# --- predict -------------------------------------------------------------------------------------


def _predict(parsed: argparse.Namespace) -> int:
    if parsed.name is None:
        _list(PREDICTIONS, "prediction", as_options=True)
        return OK
    prediction = find("prediction", PREDICTIONS, parsed.name)
    texts, as_json = _options(parsed.name, parsed.options, prediction.parameters)
    parameters = parameters_from(prediction.parameters, texts, "--")
    _check(prediction, parameters)
    _show(prediction.predict(parameters), as_json)
    return OK


def _options(name: str, words: list[str], struct: type[Struct]) -> tuple[dict[str, str], bool]:
    """The words after the name: an option for every parameter, and --json."""
    parser = argparse.ArgumentParser(prog=f"heliograph predict {name}", allow_abbrev=False)
    for key, default, description in explained(struct):
        parser.add_argument(f"--{key.replace('_', '-')}", dest=key, metavar="VALUE",
                            help=f"{description} [{default}]".replace("%", "%%"))  # fmt: skip
    add_json(parser)
    parsed = vars(parser.parse_args(words))
    as_json = bool(parsed.pop("json"))
    return {key: text for key, text in parsed.items() if text is not None}, as_json


# --- study ---------------------------------------------------------------------------------------


def _study(parsed: argparse.Namespace) -> int:
    if parsed.name is None:
        _list(STUDIES, "study", as_options=False)
        return OK
    study: Study = find("study", STUDIES, parsed.name)
    parameters = parameters_from(study.parameters, assignments(parsed.set), "--set ")
    _check(study, parameters)
    samples = parsed.samples or study.samples
    show = sys.stderr.isatty() or not parsed.json
    with _progress(samples, study.unit, show) as advance:
        result = run_study(
            study, parameters, samples=samples, seed=parsed.seed, jobs=parsed.jobs, on_progress=advance
        )
    _show(result, parsed.json)
    return OK


@contextmanager
def _progress(total: int, unit: str, show: bool) -> Iterator[Callable[[int], None]]:
    bar: tqdm[NoReturn] = tqdm(total=total, unit=f" {unit}", leave=False, disable=not show)
    with bar:

        def advance(done: int) -> None:
            bar.update(done - bar.n)

        yield advance


# --- reproduce -----------------------------------------------------------------------------------


def _reproduce(parsed: argparse.Namespace) -> int:
    if parsed.name is None:
        for name in sorted(PAPERS):
            paper = find("paper", PAPERS, name)
            print(f"{name}: {paper.title}")
            width = max(len(str(figure)) for figure in paper.figures)
            for number, figure in paper.figures.items():
                print(f"  --figure {number!s:{max(3, width)}} {figure.title}")
        return OK
    paper = find("paper", PAPERS, parsed.name)
    from scenarios.figures import Work, reproduce  # matplotlib is wanted here and nowhere else

    folder = parsed.out or Path("figures") / parsed.name
    work = Work(samples=parsed.samples, seed=parsed.seed, jobs=parsed.jobs)
    show = sys.stderr.isatty() or not parsed.json
    files = reproduce(paper, parsed.figure, folder, work, force=parsed.force, show=show)
    if parsed.json:
        print_json([str(file) for file in files])
    else:
        print("\n".join(map(str, files)))
    return OK


# --- what they share -----------------------------------------------------------------------------


def _list(listed: dict[str, str], kind: str, *, as_options: bool) -> None:
    for name in sorted(listed):
        found = find(kind, listed, name)
        print(f"{name}: {found.title}")
        rows = explained(found.parameters)
        width = max((len(key) for key, _, _ in rows), default=0)
        for key, default, description in rows:
            shown = f"--{key.replace('_', '-'):{width}}" if as_options else f"{key:{width}}"
            print(f"  {shown}  {description} [{default}]")


def _check(experiment: Study | Prediction, parameters: Struct) -> None:
    try:
        experiment.check(parameters)
    except ValueError as error:
        raise UserError(f"{experiment.name}: {error}") from error


def _show(result: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(result)
    else:
        print(score_table(result))


def _count(most: int) -> Callable[[str], int]:
    def count(text: str) -> int:
        if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"is a whole number from 1 to {most}, not {text!r}")
        return int(text)

    return count


def _figure(text: str) -> int | str:
    """A number or a name."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else text


def _seed(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"is a whole number from 0 to 2**63 - 1, not {text!r}")
    return int(text)
