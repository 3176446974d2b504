"""The `heliograph` command."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

import orjson

from emulator.arguments import Commands, add_command, add_json, print_json
from emulator.assemble import version
from emulator.errors import RunFailed, UserError
from emulator.fleet.supervisor import HASH_SEED
from emulator.progress import progress_bar
from emulator.run import FleetName, Options, Outcome, run, with_duration
from emulator.scenario import Scenario, area_m, team, world_graph
from emulator.scenario_file import load, shipped
from emulator.scoring import check_functions, score
from emulator.table import outcome_table, score_table
from emulator.verify import verify
from logs.info import format_info, info
from logs.reader import LogError, LogReader
from logs.recover import recover

OK, DIFFERENT = 0, 1
EXPERIMENTS = "scenarios.commands"


class Terminated(KeyboardInterrupt):
    """SIGTERM: end as Ctrl-C does."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Exit code 0: fine; 1: a run, check or comparison failed; 2: a mistake of the user."""
    parsed = _parser().parse_args(arguments)
    if arguments is None and getattr(parsed, "fleet", None) == "in_process":
        _fix_hash_seed()
    signal.signal(signal.SIGTERM, _terminate)
    code = _execute(parsed)
    _abandon_threads(code)
    return code


def _execute(parsed: argparse.Namespace) -> int:
    try:
        return int(parsed.command(parsed))
    except (UserError, RunFailed) as error:
        return _tell(error)
    except LogError as error:
        return _tell(UserError(str(error)))
    except KeyboardInterrupt as interrupt:
        return _tell_interrupt(interrupt)
    except BrokenPipeError:
        sys.stderr.close()  # whoever read our output has gone; nobody is left to tell
        return OK


def _fix_hash_seed() -> None:
    """Start again with the hash seed that robot processes have: it decides the order of sets of text."""
    if os.environ.get("PYTHONHASHSEED") != HASH_SEED:
        environment = {**os.environ, "PYTHONHASHSEED": HASH_SEED}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environment)


def _abandon_threads(code: int) -> None:
    """Leave at once where a behaviour's thread still works: Python would wait for it, perhaps for ever."""
    working = [thread for thread in threading.enumerate() if not thread.daemon]
    if len(working) > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _terminate(_signum: int, _frame: FrameType | None) -> None:
    raise Terminated


def _tell(error: UserError | RunFailed) -> int:
    if isinstance(error, RunFailed) and error.output:
        print(f"--- last output of {error.robot} ---", file=sys.stderr)
        print("\n".join(error.output), file=sys.stderr)
        print("---", file=sys.stderr)
    print(f"heliograph: {error}", file=sys.stderr)
    return error.exit_code


def _tell_interrupt(interrupt: KeyboardInterrupt) -> int:
    """What was cut short has noted on it what became of its log."""
    terminated = isinstance(interrupt, Terminated)
    what = "terminated" if terminated else "interrupted"
    print("heliograph: " + "; ".join([what, *getattr(interrupt, "__notes__", ())]), file=sys.stderr)
    return 128 + (signal.SIGTERM if terminated else signal.SIGINT)


# --- commands ------------------------------------------------------------------------------------


def _run(parsed: argparse.Namespace) -> int:
    scenario = _scenario(parsed)
    out = parsed.out or Path("runs") / f"{scenario.name}-{scenario.seed}.mcap"
    _refuse_to_overwrite(parsed, out)
    with progress_bar(scenario.run.duration_s, show=sys.stderr.isatty() or not parsed.json) as advance:
        outcome = run(
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
    result: dict[str, Any] | None = None
    try:
        result = score(outcome.log, scenario.folder)
    except UserError as error:
        raise UserError(f"{error}; the log is whole: {outcome.log}") from error
    finally:  # what the run cost is not lost with its score
        _report(parsed, outcome, result)
    return OK


def _refuse_to_overwrite(parsed: argparse.Namespace, out: Path) -> None:
    """--force is meant for an old log, not for what the run is made of or writes besides."""
    if out.resolve() == Path(parsed.scenario).resolve():
        raise UserError(f"--out {out}: is the scenario itself; choose another --out")
    if parsed.stats is None:
        return
    if parsed.stats.resolve() in (out.resolve(), Path(parsed.scenario).resolve()):
        raise UserError(f"--stats {parsed.stats}: is the log or the scenario; choose another file")
    if not parsed.stats.parent.is_dir():
        raise UserError(f"--stats {parsed.stats}: there is no folder {parsed.stats.parent}; make it first")


def _report(parsed: argparse.Namespace, outcome: Outcome, result: dict[str, Any] | None) -> None:
    if parsed.json:
        print_json(outcome.summary(result))
    else:
        print(outcome_table(outcome, result or {}))
    if outcome.overruns:
        print(f"heliograph: {outcome.overruns} instants were late at --rate {parsed.rate:g}", file=sys.stderr)
    if parsed.stats is not None:
        _write_stats(parsed.stats, outcome)


def _scenarios(parsed: argparse.Namespace) -> int:
    found = shipped()
    if parsed.json:
        print_json([{"name": name, "title": title} for name, title in found])
    else:
        width = max((len(name) for name, _ in found), default=0)
        for name, title in found:
            print(f"{name:{width}}  {title}")
    return OK


def _check(parsed: argparse.Namespace) -> int:
    scenario = _scenario(parsed)
    check_functions(scenario)
    width, height = area_m(scenario)
    graph = world_graph(scenario)
    of_graph = f", a graph of {len(graph.vertices)} vertices and {len(graph.edges)} edges" if graph else ""
    print(
        f"{scenario.name}: fine; {len(team(scenario))} robots on {width:.1f} m x {height:.1f} m{of_graph}, "
        f"at most {scenario.run.duration_s:g} s"
    )
    return OK


def _score(parsed: argparse.Namespace) -> int:
    _warn_of_what_is_missing(parsed.log)
    result = score(parsed.log, parsed.source)
    if parsed.json:
        print_json(result)
    else:
        print(score_table(result))
    return OK


def _warn_of_what_is_missing(path: Path) -> None:
    with LogReader(path) as log:
        if log.torn:
            print(f"heliograph: {path} is torn or damaged; this scores what can be read", file=sys.stderr)
        elif not log.complete:
            print(f"heliograph: {path} is of an aborted run; this scores it up to there", file=sys.stderr)


def _info(parsed: argparse.Namespace) -> int:
    about = info(parsed.log)
    if parsed.json:
        print_json(about)
    else:
        print(format_info(about))
    return OK


def _recover(parsed: argparse.Namespace) -> int:
    saved = recover(parsed.log, parsed.out, force=parsed.force)
    messages = sum(saved.messages.values())
    print(f"{parsed.out}: {messages} messages saved, {saved.lost_bytes} bytes were beyond saving")
    return OK


def _verify(parsed: argparse.Namespace) -> int:
    difference = verify(parsed.log, parsed.fleet, parsed.source)
    if difference is None:
        print(f"{parsed.log}: the same, byte for byte")
        return OK
    print(difference)
    return DIFFERENT


def _scenario(parsed: argparse.Namespace) -> Scenario:
    scenario = load(parsed.scenario, robots=parsed.robots, seed=parsed.seed, overrides=parsed.set)
    if parsed.duration is None:
        return scenario
    return with_duration(scenario, parsed.duration)


def _write_stats(path: Path, outcome: Outcome) -> None:
    try:
        path.write_bytes(orjson.dumps(outcome.stats(), option=orjson.OPT_INDENT_2) + b"\n")
    except OSError as error:
        raise UserError(f"--stats: cannot write {path}: {error.strerror}; choose another file") from None


# --- arguments -----------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="heliograph",
        description="Emulate teams of robots that talk by radio and by sight.",
        epilog="Exit codes: 0 fine, 1 a run or a comparison failed, 2 a mistake in what was asked.",
    )
    parser.add_argument("--version", action="version", version=f"heliograph {version()}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    _add_run(commands)

    scenarios = add_command(commands, "scenarios", _scenarios, "list the scenarios that come with Heliograph")
    add_json(scenarios)

    own_params = "A behaviour's own [params] are not checked here: the behaviour does that when it starts."
    check = add_command(commands, "check", _check, "validate a scenario without running it", own_params)
    _add_scenario(check)

    scored = add_command(commands, "score", _score, "score a log alone")
    _add_log(scored)
    _add_source(scored, "scoring function")
    add_json(scored)

    verified = add_command(commands, "verify", _verify, "run again what a log holds, and compare")
    _add_log(verified)
    _add_fleet(verified)
    _add_source(verified, "behaviours")

    about = add_command(commands, "info", _info, "what is in a log")
    _add_log(about)
    add_json(about)

    whole = add_command(commands, "recover", _recover, "make a whole log of a torn one")
    _add_log(whole)
    whole.add_argument("--out", type=Path, required=True, metavar="FILE", help="where to write it")
    whole.add_argument("--force", action="store_true", help="overwrite an existing file")

    # Experiments bring commands of their own. They stand above the emulator: named, not imported.
    import_module(EXPERIMENTS).add_commands(commands)
    return parser


def _add_run(commands: Commands) -> None:
    parser = add_command(commands, "run", _run, "run a scenario, record it, score it")
    _add_scenario(parser)
    parser.add_argument("--rate", type=_rate, default=None, metavar="max|FLOAT",
                        help="virtual seconds per second (default: max, as fast as it can)")  # fmt: skip
    _add_fleet(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="log (default: runs/SCENARIO-SEED.mcap)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing log")
    parser.add_argument("--stats", type=Path, metavar="FILE", help="write wall-clock statistics as JSON")
    parser.add_argument("--listen", metavar="ENDPOINT",
                        help="broker endpoint, as tcp/127.0.0.1:7447 (default: a Unix socket)")  # fmt: skip
    add_json(parser)


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
                        help=f"where the Python files of the {what} are (default: in the log)")  # fmt: skip


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
