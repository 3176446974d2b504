"""`python -m tests.bench`: what things cost here and now, as numbers and as ratios within this run."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from tests.bench.layout import spread
from tests.bench.measure import environment, load_average
from tests.bench.plan import FULL, QUICK, SPEED, Bench, Samples
from tests.bench.report import TABLES, tables


def main(arguments: Sequence[str]) -> int:
    """Measure and print. Whatever the numbers are, the exit code is 0."""
    options = _parser().parse_args(arguments)
    names = options.only or list(TABLES)
    effort = QUICK if options.quick else FULL
    if options.rounds is not None:
        effort = replace(effort, rounds=options.rounds)
    about = environment()
    for name, value in about.items():
        print(f"{name}: {value}")
    print(f"figures: median (min-max) of {effort.rounds} rounds, cells interleaved\n", flush=True)
    begun = time.monotonic()
    samples = Bench(effort).run(names)
    about |= {"load afterwards": load_average(), "took": f"{time.monotonic() - begun:.0f} s"}
    print(tables(samples, names))
    print(f"\ncores busy with anything else while measuring: {spread(samples.everywhere('others_cores'), 2)}")
    print(f"a pass of a fixed Python loop: {spread(samples.values(SPEED, 'pass_ns'))} ns")
    print(f"took {about['took']}, load average afterwards {about['load afterwards']}")
    if options.json is not None:
        options.json.write_text(json.dumps(_document(about, samples), indent=1) + "\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="one short round: numbers to look at, not to quote"
    )
    parser.add_argument("--only", action="append", choices=list(TABLES), metavar="NAME",
                        help=f"one table of: {', '.join(TABLES)}; may be given again")  # fmt: skip
    parser.add_argument("--rounds", type=int, metavar="N", help="how often every cell is measured")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure of every round")
    return parser


def _document(about: Mapping[str, str], samples: Samples) -> dict[str, Any]:
    return {
        "environment": dict(about),
        "sizes": {str(cell): asdict(sizes) for cell, sizes in samples.sizes.items()},
        "rounds": [{str(cell): figures for cell, figures in done.items()} for done in samples.rounds],
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
