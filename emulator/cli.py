"""The `heliograph` command."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import orjson

from emulator import run as running
from emulator.errors import RunFailed, UserError
from emulator.progress import progress_bar
from emulator.run import FleetName, Options, Outcome
from emulator.scenario import Scenario, area_m, team
from emulator.scenario_file import load, shipped
from emulator.table import outcome_table, score_table
from emulator.verify import verify
from logs.info import format_info, info
from logs.reader import LogError
from logs.recover import recover

OK, FAILED, USER_ERROR = 0, 1, 2
STATS_KIND = "wall-clock statistics; they differ from run to run"


class Terminated(KeyboardInterrupt):
    """SIGTERM: end as Ctrl-C does."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Exit code 0: fine; 1: a run, check or comparison failed; 2: a mistake of the user."""
    parsed = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _terminate)
    try:
        return int(parsed.command(parsed))
    except (UserError, LogError) as error:
        print(f"heliograph: {error}", file=sys.stderr)
        return USER_ERROR
    except RunFailed as failure:
        _print_failure(failure)
        return FAILED
    except Terminated:
        print("heliograph: terminated; the log is whole up to this instant", file=sys.stderr)
        return 128 + signal.SIGTERM
    except KeyboardInterrupt:
        print("heliograph: interrupted; the log is whole up to this instant", file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        sys.stderr.close()  # whoever read our output has gone; nobody is left to tell
        return OK


def _terminate(_signum: int, _frame: FrameType | None) -> None:
    raise Terminated


def _print_failure(failure: RunFailed) -> None:
    if failure.output:
        print(f"--- last output of {failure.robot} ---", file=sys.stderr)
        print("\n".join(failure.output), file=sys.stderr)
        print("---", file=sys.stderr)
    print(f"heliograph: {failure}", file=sys.stderr)


# --- commands ------------------------------------------------------------------------------------


def _run(parsed: argparse.Namespace) -> int:
    scenario = _scenario(parsed)
    out = parsed.out or Path("runs") / f"{scenario.name}-{scenario.seed}.mcap"
    with progress_bar(scenario.run.duration_s, show=sys.stderr.isatty() or not parsed.json) as advance:
        outcome = running.run(
            scenario,
            Options(
                out=out,
                fleet=parsed.fleet,
                force=parsed.force,
                rate=parsed.rate,
                listen=parsed.listen,
                on_progress=advance,
            ),
        )
    if parsed.stats is not None:
        _write_stats(parsed.stats, outcome)
    if parsed.json:
        _print_json(outcome.summary())
    else:
        print(outcome_table(outcome))
    if outcome.overruns:
        print(f"heliograph: {outcome.overruns} instants were late at --rate {parsed.rate:g}", file=sys.stderr)
    return OK


def _scenarios(parsed: argparse.Namespace) -> int:
    found = shipped()
    if parsed.json:
        _print_json([{"name": name, "title": title} for name, title in found])
    else:
        width = max((len(name) for name, _ in found), default=0)
        for name, title in found:
            print(f"{name:{width}}  {title}")
    return OK


def _check(parsed: argparse.Namespace) -> int:
    scenario = _scenario(parsed)
    running.check_functions(scenario)
    width, height = area_m(scenario)
    print(
        f"{scenario.name}: fine; {len(team(scenario))} robots on {width:.1f} m x {height:.1f} m, "
        f"at most {scenario.run.duration_s:g} s"
    )
    return OK


def _score(parsed: argparse.Namespace) -> int:
    result = running.score(parsed.log, parsed.source or parsed.log.parent)
    if parsed.json:
        _print_json(result)
    else:
        print(score_table(result))
    return OK


def _info(parsed: argparse.Namespace) -> int:
    about = info(parsed.log)
    if parsed.json:
        _print_json(about)
    else:
        print(format_info(about))
    return OK


def _recover(parsed: argparse.Namespace) -> int:
    counts = recover(parsed.log, parsed.out, force=parsed.force)
    print(f"{parsed.out}: {counts}")
    return OK


def _verify(parsed: argparse.Namespace) -> int:
    difference = verify(parsed.log, parsed.fleet, parsed.source)
    if difference is None:
        print(f"{parsed.log}: the same, byte for byte")
        return OK
    print(difference)
    return FAILED


def _scenario(parsed: argparse.Namespace) -> Scenario:
    scenario = load(parsed.scenario, robots=parsed.robots, seed=parsed.seed, overrides=parsed.set)
    if parsed.duration is None:
        return scenario
    return running.with_duration(scenario, parsed.duration)


def _write_stats(path: Path, outcome: Outcome) -> None:
    stats = {
        "kind": STATS_KIND,
        "wall_s": outcome.wall_s,
        "startup_s": outcome.startup_s,
        "activations": outcome.progress.activations,
        "us_per_activation": 1e6 * outcome.wall_s / max(1, outcome.progress.activations),
        "real_time_factor": outcome.progress.now_ns / 1e9 / outcome.wall_s,
        "overruns": outcome.overruns,
        "recording_s": outcome.recording_s,
        "recording_cpu_s": outcome.recording_cpu_s,
    }
    try:
        path.write_bytes(orjson.dumps(stats, option=orjson.OPT_INDENT_2) + b"\n")
    except OSError as error:
        raise UserError(f"--stats: cannot write {path}: {error.strerror}; choose another file") from None


def _print_json(value: Any) -> None:
    print(orjson.dumps(value, option=orjson.OPT_INDENT_2).decode())


# --- arguments -----------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="heliograph",
        description="Emulate teams of robots that talk by radio and by sight.",
        epilog="Exit codes: 0 fine, 1 a run or a comparison failed, 2 a mistake in what was asked.",
    )
    parser.add_argument("--version", action="version", version=f"heliograph {running.version()}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = _command(commands, "run", _run, "run a scenario, record it, score it")
    _add_scenario(run)
    run.add_argument("--rate", type=_rate, default=None, metavar="max|FLOAT",
                     help="virtual seconds per second (default: max, as fast as it can)")  # fmt: skip
    _add_fleet(run)
    run.add_argument("--out", type=Path, metavar="FILE", help="log (default: runs/SCENARIO-SEED.mcap)")
    run.add_argument("--force", action="store_true", help="overwrite an existing log")
    run.add_argument("--stats", type=Path, metavar="FILE", help="write wall-clock statistics as JSON")
    run.add_argument("--listen", metavar="ENDPOINT",
                     help="broker endpoint, as tcp/127.0.0.1:7447 (default: a Unix socket)")  # fmt: skip
    _add_json(run)

    scenarios = _command(commands, "scenarios", _scenarios, "list the scenarios that come with Heliograph")
    _add_json(scenarios)

    check = _command(commands, "check", _check, "validate a scenario without running it")
    _add_scenario(check)

    score = _command(commands, "score", _score, "score a log alone")
    _add_log(score)
    _add_source(score, "scoring function")
    _add_json(score)

    verified = _command(commands, "verify", _verify, "run again what a log holds, and compare")
    _add_log(verified)
    _add_fleet(verified)
    _add_source(verified, "behaviours")

    about = _command(commands, "info", _info, "what is in a log")
    _add_log(about)
    _add_json(about)

    whole = _command(commands, "recover", _recover, "make a whole log of a torn one")
    _add_log(whole)
    whole.add_argument("--out", type=Path, required=True, metavar="FILE", help="where to write it")
    whole.add_argument("--force", action="store_true", help="overwrite an existing file")
    return parser


Commands = Any  # argparse names no type for it


def _command(
    commands: Commands, name: str, command: Callable[[argparse.Namespace], int], text: str
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=text.capitalize() + "."
    )
    parser.set_defaults(command=command)
    return parser


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a shipped scenario's name or a TOML file")
    parser.add_argument("--robots", type=int, metavar="N", help="size of the team")
    parser.add_argument("--seed", type=int, metavar="S", help="seed of all randomness")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                        help="change one key of the scenario, as radio.loss=0.1")  # fmt: skip
    parser.add_argument("--duration", type=float, metavar="SECONDS",
                        help="virtual seconds to run, exactly, whatever the stop rule")  # fmt: skip


def _add_fleet(parser: argparse.ArgumentParser) -> None:
    names: tuple[FleetName, ...] = ("zenoh", "in_process")
    parser.add_argument("--fleet", choices=names, default="zenoh",
                        help="one process per robot over Zenoh (default), or all in this one")  # fmt: skip


def _add_log(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG", help="an MCAP log of a run")


def _add_source(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--source", type=Path, metavar="FOLDER",
                        help=f"where the Python files of the {what} are")  # fmt: skip


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON value and nothing else")


def _rate(text: str) -> float | None:
    if text == "max":
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate < float("inf"):
        raise argparse.ArgumentTypeError(f"is 'max' or a number greater than 0, not {text!r}")
    return rate


if __name__ == "__main__":
    sys.exit(main())
