"""User files: loaded under names of their own, listed, and forgotten; and how a host tells an ending."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from agent.endings import exit_code, one_line, sentence
from agent.host import RobotHost
from agent.loading import BehaviourError, files_used, forget_user_modules, load_behaviour, load_function
from agent.virtual_time import GrantedTimeLoop
from channels.messages import MAX_REPORT_BYTES, Grant, Hello, RadioPlan, decode_report, encode
from emulator.fleet.in_process import InProcessFleet

PLAN = RadioPlan(max_payload_bytes=100, overhead_bits=0, bit_rate_bps=None, queue=10)


@pytest.fixture(autouse=True)
def _nothing_is_left(tmp_path: Path) -> Iterator[None]:
    before, path = set(sys.modules), list(sys.path)
    yield
    forget_user_modules(tmp_path)
    assert not {name for name in set(sys.modules) - before if "behaviour_" in name or "neighbour" in name}
    assert sys.path == path


def hello(robot: str, behaviour: str, **params: object) -> Hello:
    return Hello(robot, behaviour, params, 0, 0, (0.0, 0.0, 0.0), PLAN, 1)


def test_files_whose_paths_differ_in_punctuation_alone_are_two_modules(tmp_path: Path) -> None:
    for number, folder in enumerate(("a-b", "a_b")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "robot.py").write_text(f"def which():\n    return {number}\n")
    assert [load_function(f"{name}/robot.py:which", tmp_path)() for name in ("a-b", "a_b")] == [0, 1]


def test_what_is_forgotten_is_loaded_anew_as_it_is_now(tmp_path: Path) -> None:
    (tmp_path / "neighbour_x.py").write_text("seen = []\nword = 'old'\n")
    (tmp_path / "robot.py").write_text(
        "import neighbour_x\ndef see():\n    neighbour_x.seen.append(1)\n"
        "    return neighbour_x.word, len(neighbour_x.seen)\n"
    )
    assert load_function("robot.py:see", tmp_path)() == ("old", 1)
    assert load_function("robot.py:see", tmp_path)() == ("old", 2)
    (tmp_path / "neighbour_x.py").write_text("seen = []\nword = 'new'\n")
    forget_user_modules(tmp_path)
    assert load_function("robot.py:see", tmp_path)() == ("new", 1)


def test_our_own_and_installed_packages_are_never_forgotten() -> None:
    before = dict(sys.modules)
    forget_user_modules(Path(sys.modules["agent"].__file__ or "").parent.parent / "agent")
    forget_user_modules(Path(pytest.__file__).parent.parent)
    assert dict(sys.modules) == before


def test_files_used(tmp_path: Path) -> None:
    (tmp_path / "neighbours").mkdir()
    (tmp_path / "neighbours" / "far.py").write_text("")
    (tmp_path / "unused.py").write_text("")
    (tmp_path / "robot.py").write_text("import neighbours.far\nasync def main(robot):\n    pass\n")
    names = ["robot.py:main", "agent.behaviours.association.stationary:associate", ""]
    assert files_used(names, tmp_path) == ["neighbours/far.py", "robot.py"]
    with pytest.raises(BehaviourError, match=r"no file other\.py"):
        files_used(["other.py:main"], tmp_path)


def test_runs_in_one_process_share_nothing(tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text(
        "seen = []\nasync def main(robot):\n    seen.append(robot.id)\n"
        "    robot.params['list'].append(robot.id)\n"
        "    robot.log('seen', {'all': list(seen), 'own': robot.params['list']})\n"
    )
    shared: list[str] = []
    texts = []
    for _ in range(2):
        fleet = InProcessFleet(tmp_path, 10.0)
        fleet.start([hello(name, "robot.py:main", list=shared) for name in ("r0", "r1")])
        reports = list(fleet.exchange([(index, encode(Grant(1, 0))) for index in (0, 1)], lambda: None))
        fleet.close()
        texts.append([report.entries[0].text for report in reports])
    assert texts[0] == texts[1] == [b'{"all":["r0"],"own":["r0"]}', b'{"all":["r0","r1"],"own":["r1"]}']
    assert shared == []


def test_a_robot_that_prints_leaves_standard_output_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.py").write_text("print('import')\nasync def main(robot):\n    print('run')\n")
    fleet = InProcessFleet(tmp_path, 10.0)
    fleet.start([hello("r0", "robot.py:main")])
    list(fleet.exchange([(0, encode(Grant(1, 0)))], lambda: None))
    fleet.close()
    assert capsys.readouterr() == ("", "import\nrun\n")


def ended(tmp_path: Path, body: str) -> str | None:
    (tmp_path / "robot.py").write_text(f"import asyncio, sys\nasync def main(robot):\n    {body}\n")
    host = RobotHost(hello("r0", "robot.py:main"), load_behaviour("robot.py:main", tmp_path))
    raw = host.exchange(encode(Grant(1, 0)))
    host.close()
    assert raw is not None
    return decode_report(raw).ended


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("raise ValueError('\\ud800 half')", "ValueError: \\ud800 half"),
        ("raise ValueError(object())", "ValueError: <object object at 0x...>"),
        ("raise ValueError('x\\n' * 10**6)", ("ValueError:" + " x" * 1000)[:1000]),
        ("for _ in range(200): robot.log('long', {'x': 'x' * 100_000})", "TooMuchAtOnce: what it did at one instant takes "),
        ("while True: await asyncio.sleep(0)", "RuntimeError: not idle after 1000 rounds"),
    ],
)  # fmt: skip
def test_every_ending_is_told_in_one_line(
    body: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(GrantedTimeLoop, "rounds_limit", 1000)
    told = ended(tmp_path, body)
    assert told is not None
    assert told.startswith(sentence)
    assert len(told) <= 1000
    assert MAX_REPORT_BYTES < 200 * 100_000


def test_exit_codes_are_those_of_python(capsys: pytest.CaptureFixture[str]) -> None:
    codes = [None, 0, 4, True, -1, "text"]
    assert [exit_code(SystemExit(code)) for code in codes] == [0, 0, 4, 1, 255, 1]
    assert capsys.readouterr().err == "text\n"


def test_an_error_without_a_text_has_a_sentence() -> None:
    class Mute(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    assert sentence(Mute()) == "Mute: (its text cannot be had)"
    assert one_line("0x12345 0x123456", 9) == "0x12345 0"


def test_one_that_cannot_be_closed_keeps_no_other_open(tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text(
        "import asyncio, sys\nclosed = []\nsys.neighbour_closed = closed\n"
        "async def main(robot):\n    try:\n        await asyncio.sleep(9)\n    finally:\n"
        "        closed.append(robot.id)\n        sys.exit(3) if robot.id == 'r1' else None\n"
    )
    fleet = InProcessFleet(tmp_path, 10.0)
    fleet.start([hello(name, "robot.py:main") for name in ("r0", "r1", "r2")])
    list(fleet.exchange([(index, encode(Grant(1, 0))) for index in range(3)], lambda: None))
    fleet.close()
    closed = sys.__dict__.pop("neighbour_closed")
    assert closed == ["r0", "r1", "r2"]
