"""What happens when robots, users or machines misbehave: one plain story, a whole log, nothing left."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from logs import LogError
from logs.reader import LogReader
from tests.support import TIMEOUT_S, heliograph, write_scenario

pytestmark = pytest.mark.processes

TOML = """
behaviour = "my_robot.py:main"
robots = 3
[run]
duration_s = 5.0
[world]
area_m = [10.0, 10.0]
[radio]
range_m = 20.0
max_payload_bytes = 64
[limits]
answer_timeout_s = 1.5
"""

PREAMBLE = """
import asyncio, os, signal, sys, time
from agent import Robot

async def main(robot: Robot) -> None:
    await asyncio.sleep(1.0)
    robot.radio.broadcast({"id": robot.id})
    robot.log("alive", {"at": robot.now_ns})
    await asyncio.sleep(1.0)
    if robot.id == "r01":
        print("famous last words")
        bad(robot)
    await asyncio.sleep(10.0)
"""

FAULTS = {
    "raises": ("    raise ValueError('boom')", "robot r01 failed: ValueError: boom"),
    "exits": ("    os._exit(3)", "robot r01 exited with code 3"),
    "leaves": ("    sys.exit(4)", "robot r01 exited with code 4"),
    "is killed": ("    os.kill(os.getpid(), signal.SIGKILL)", "robot r01 was killed by signal 9"),
    "never awaits": (
        "    while True: pass",
        "robot r01 did not answer within 1.5 s; does it loop without awaiting?",
    ),
    "blocks": (
        "    time.sleep(100)",
        "robot r01 did not answer within 1.5 s; does it loop without awaiting?",
    ),
    "floods": (
        "    for _ in range(10**6): robot.radio.broadcast(1)",
        "robot r01 failed: TooMuchAtOnce: more than 1000 radio messages at one instant; await between broadcasts",
    ),
    "sends too much": (
        "    robot.radio.broadcast('x' * 100)",
        "robot r01 failed: MessageTooLong: a payload of 102 bytes; the scenario's radio.max_payload_bytes is 64",
    ),
    "sends what has no form": (
        "    robot.radio.broadcast(object())",
        "robot r01 failed: TypeError: values of type object cannot be sent or logged",
    ),
    "logs what has no form": (
        "    robot.log('odd', {'inner': {(1, 2): object()}})",
        "robot r01 failed: TypeError: ",
    ),
    "drives without wheels": (
        "    robot.body.drive(1.0, 0.0)",
        "robot r01 gave a motion command that cannot be followed",
    ),
}
ENDS_THE_PROCESS = {"exits", "is killed"}
PARTS = [
    pytest.param(fault, fleet, id=f"{fault}-{fleet}")
    for fault in FAULTS
    for fleet in ("zenoh", "in_process")
    if not (fleet == "in_process" and fault in ENDS_THE_PROCESS)
]


def leftovers() -> set[str]:
    """Robot and zygote processes, and socket folders, of this process's tests."""
    ours = f"\0TMPDIR={tempfile.gettempdir()}\0".encode()
    found = {str(path) for path in Path(tempfile.gettempdir()).glob("heliograph-*")}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes()
            environment = (process / "environ").read_bytes()
        except OSError:
            continue
        if b"agent.zygote" in command and ours in b"\0" + environment:
            found.add(process.name)
    return found


@pytest.fixture(autouse=True)
def _nothing_is_left() -> object:
    before = leftovers()
    yield
    deadline = time.monotonic() + 10.0
    while leftovers() - before and time.monotonic() < deadline:
        time.sleep(0.05)
    assert leftovers() - before == set()


def whole_log(path: Path) -> LogReader:
    """The log of a run that was cut short: readable, not torn, and marked as aborted."""
    log = LogReader(path)
    assert not log.torn
    assert not log.complete
    return log


@pytest.mark.parametrize(("fault", "fleet"), PARTS)
def test_a_robot_that(fault: str, fleet: str, tmp_path: Path) -> None:
    code, sentence = FAULTS[fault]
    scenario = write_scenario(tmp_path, f"{PREAMBLE}\n\ndef bad(robot):\n{code}\n", TOML)
    out = tmp_path / "log.mcap"
    done = heliograph("run", scenario, "--fleet", fleet, "--out", out, "--json")
    assert done.returncode == 1, done.stderr
    assert done.stdout == "" or fleet == "in_process"
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"heliograph: {sentence}"), done.stderr
    assert "(at 2 s; the log up to then is" in last
    if fleet == "zenoh":
        assert "famous last words" in done.stderr.split("--- last output of r01 ---")[1]
    with whole_log(out) as log:
        alive = [(at, record["robot"]) for at, record in log.records("/robot") if record["entry"] == "alive"]
        assert alive == [(10**9, robot) for robot in ("r00", "r01", "r02")]
        assert len(list(log.records("/radio"))) == 3
        faults = [record for _, record in log.records("/faults")]
        assert faults[-1]["robot"] == "r01"


def test_what_a_robot_prints_is_shown_with_its_name(tmp_path: Path) -> None:
    code = "async def main(robot):\n    print('hello from', robot.id)\n"
    done = heliograph("run", write_scenario(tmp_path, code, TOML), "--out", tmp_path / "log.mcap")
    assert done.returncode == 0, done.stderr
    for robot in ("r00", "r01", "r02"):
        assert f"{robot} | hello from {robot}" in done.stderr


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        ("import nothing_of_this_name\n", "my_robot.py fails to import: ModuleNotFoundError"),
        ("def main(robot) oops\n", "my_robot.py fails to import: SyntaxError"),
        ("x = 1\n", "my_robot.py has no function 'main'"),
        ("async def main():\n    pass\n", "my_robot.py:main cannot be called with the robot alone: too many"),
        ("def main(robot):\n    pass\n", "my_robot.py:main is not an `async def` function"),
        ("raise SystemExit(5)\n", "importing the behaviour ended with SystemExit: 5"),
    ],
)
def test_a_behaviour_that_cannot_be_used(code: str, sentence: str, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path, code, TOML)
    done = heliograph("run", scenario, "--out", tmp_path / "log.mcap")
    assert done.returncode == 2, done.stderr
    assert done.stderr.strip().startswith(f"heliograph: behaviour: {sentence}"), done.stderr
    assert "\n" not in done.stderr.strip()
    assert not (tmp_path / "log.mcap").exists()


ENDLESS = """
import asyncio
async def main(robot):
    while True:
        await asyncio.sleep(0.1)
        robot.radio.broadcast(robot.id)
"""


def start_endless(folder: Path) -> subprocess.Popen[str]:
    """A run that takes minutes, already recording."""
    return start_recording(folder, ENDLESS, 20, "--rate", "5")


def start_recording(folder: Path, code: str, transmissions: int, *options: str) -> subprocess.Popen[str]:
    """A long run of which more than so many transmissions are already in `log.mcap`."""
    scenario = write_scenario(folder, code, TOML)
    out = folder / "log.mcap"
    command = [sys.executable, "-m", "emulator", "run", str(scenario), "--out", str(out), "--json"]
    process = subprocess.Popen(
        [*command, "--duration", "1000", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + TIMEOUT_S
    while radio_records(out) <= transmissions and time.monotonic() < deadline:
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.05)
    return process


def radio_records(path: Path) -> int:
    try:
        with LogReader(path) as log:
            return len(list(log.records("/radio")))
    except LogError:
        return 0


@pytest.mark.parametrize(("how", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted(how: signal.Signals, code: int, tmp_path: Path) -> None:
    process = start_endless(tmp_path)
    process.send_signal(how)
    stdout, stderr = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == code, stderr
    assert stdout == ""
    assert stderr.strip().endswith("the log is whole up to this instant")
    with whole_log(tmp_path / "log.mcap") as log:
        assert len(list(log.records("/radio"))) > 20


@pytest.mark.parametrize("delay_s", [0.013 * number for number in range(10)])
def test_interrupted_at_any_moment(delay_s: float, tmp_path: Path) -> None:
    """Wherever Ctrl-C strikes, also in the middle of a record, no half of anything is left."""
    busy = ENDLESS.replace("0.1", "0.001")
    process = start_recording(tmp_path, busy, 0, "--fleet", "in_process")
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(delay_s)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 130, stderr
    with whole_log(tmp_path / "log.mcap") as log:
        sequences = [sequence for _, sequence, _, _ in log.raw()]
        assert sequences == list(range(len(sequences)))
        for topic in ("/radio", "/robot", "/truth", "/faults"):
            list(log.records(topic))


def test_slow_robots_have_their_full_time_each(tmp_path: Path) -> None:
    """Six robots that compute for half the deadline each, on fewer processors than robots."""
    code = """
import time
async def main(robot):
    begun = time.process_time()
    while time.process_time() - begun < 0.75:
        pass
"""
    scenario = write_scenario(tmp_path, code, TOML.replace("robots = 3", "robots = 6"))
    done = heliograph("run", scenario, "--out", tmp_path / "log.mcap", prefix=["taskset", "-c", "0"])
    assert done.returncode == 0, done.stderr


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be taken note of does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_what_a_robot_started_ends_with_it(tmp_path: Path) -> None:
    code = """
import os, subprocess
async def main(robot):
    child = subprocess.Popen(["sleep", "4711"])
    print("started", child.pid)
    if robot.id == "r02":
        os._exit(0)
"""
    done = heliograph("run", write_scenario(tmp_path, code, TOML), "--out", tmp_path / "log.mcap")
    started = [int(line.split()[-1]) for line in done.stderr.splitlines() if "| started" in line]
    assert len(started) == 3, done.stderr
    assert not any(map(is_alive, started))


def test_broker_killed(tmp_path: Path) -> None:
    process = start_endless(tmp_path)
    process.kill()
    process.communicate(timeout=TIMEOUT_S)
    with LogReader(tmp_path / "log.mcap") as log:  # readable to its last whole chunk
        assert log.torn
        assert len(list(log.records("/radio"))) > 20


def test_zygote_killed(tmp_path: Path) -> None:
    process = start_endless(tmp_path)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    os.kill(int(children[0]), signal.SIGKILL)
    _, stderr = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 1
    assert "was lost: the process that starts the robots is gone" in stderr
    whole_log(tmp_path / "log.mcap").close()


def test_a_port_that_is_taken(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = heliograph("run", "association", "--out", tmp_path / "log.mcap", "--listen", endpoint)
    assert done.returncode == 2
    assert (
        done.stderr.strip().splitlines()[-1].startswith(f"heliograph: --listen: cannot listen at {endpoint}")
    )


def test_over_tcp(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    done = heliograph(
        "run",
        "association",
        "--robots",
        4,
        "--out",
        tmp_path / "tcp.mcap",
        "--listen",
        f"tcp/127.0.0.1:{port}",
    )
    assert done.returncode == 0, done.stderr
    again = heliograph("run", "association", "--robots", 4, "--out", tmp_path / "unix.mcap")
    assert again.returncode == 0
    assert (tmp_path / "tcp.mcap").read_bytes() == (tmp_path / "unix.mcap").read_bytes()


@pytest.mark.parametrize("fleet", ["zenoh", "in_process"])
@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        ("sys.exit('enough')", "robot r01 exited with code 1"),
        (
            "raise ValueError(object(), '\\ud800')",
            "robot r01 failed: ValueError: (<object object at 0x...>, ",
        ),
        (
            "robot.log('', {})",
            "robot r01 failed: ValueError: the name of an entry has 1 to 100 characters, not 0",
        ),
    ],
)
def test_an_end_reads_the_same_in_both_fleets(fleet: str, bad: str, sentence: str, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path, f"{PREAMBLE}\n\ndef bad(robot):\n    {bad}\n", TOML)
    out = tmp_path / "log.mcap"
    done = heliograph("run", scenario, "--fleet", fleet, "--out", out, "--json")
    assert done.returncode == 1, done.stderr
    assert done.stdout == ""
    assert done.stderr.strip().splitlines()[-1].startswith(f"heliograph: {sentence}"), done.stderr
    assert fleet == "zenoh" or "enough" not in bad or "enough\n" in done.stderr


def test_a_last_line_that_is_not_ended_is_shown(tmp_path: Path) -> None:
    code = "async def main(robot):\n    print('bye from', robot.id, end='')\n"
    done = heliograph("run", write_scenario(tmp_path, code, TOML), "--out", tmp_path / "log.mcap")
    assert done.returncode == 0, done.stderr
    for robot in ("r00", "r01", "r02"):
        assert f"{robot} | bye from {robot}\n" in done.stderr


SETS = """
async def main(robot):
    names = {f"name {number}" for number in range(50)}
    robot.log("walked", {"names": [name for name in names]})
    robot.radio.broadcast(set(list(names)[:5]))
    robot.log("set", {"names": names})
"""


def test_sets_of_text_have_one_order_in_all_robot_processes(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path, SETS, TOML)
    for name, hash_seed in (("a", 1), ("b", 2)):
        out = tmp_path / f"{name}.mcap"
        prefix = ["env", f"PYTHONHASHSEED={hash_seed}"]
        done = heliograph("run", scenario, "--out", out, prefix=prefix)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


SNOOP = """
import gc, sys

def held():
    '''Everything in the frames below this one, and in all containers there are.'''
    objects = gc.get_objects()
    found = [thing for thing in objects if type(thing) is tuple]
    for thing in objects:
        if type(thing) is list and thing is not objects:
            found += thing
    frame = sys._getframe(1)
    while frame is not None:
        found += frame.f_locals.values()
        frame = frame.f_back
    return found

def is_a_secret_of(thing, name):
    if type(thing) is bytes:
        return name.encode() in thing
    return type(thing) is tuple and len(thing) == 2 and thing[0] == name and type(thing[1]) is str

async def main(robot):
    things = held()
    others = {"r00", "r01", "r02"} - {robot.id}
    found = [name for name in others if any(is_a_secret_of(thing, name) for thing in things)]
    robot.log("snooped", {"things": len(things) > 100, "found": found})
"""


def test_a_robot_holds_no_password_of_another(tmp_path: Path) -> None:
    out = tmp_path / "log.mcap"
    done = heliograph("run", write_scenario(tmp_path, SNOOP, TOML), "--out", out)
    assert done.returncode == 0, done.stderr
    with LogReader(out) as log:
        entries = [record["data"] for _, record in log.records("/robot")]
    assert entries == [{"things": True, "found": []}] * 3


def test_a_file_called_as_one_of_ours_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "agent.py").write_text("raise SystemExit('the wrong one')\n")
    code = "async def main(robot):\n    robot.log('up', {})\n"
    scenario = write_scenario(tmp_path, code, TOML)
    script = Path(sys.executable).with_name("heliograph")
    if not script.exists():
        pytest.skip("the command is not installed beside this Python")
    done = subprocess.run(
        [script, "run", scenario, "--out", tmp_path / "log.mcap"],
        capture_output=True, text=True, timeout=TIMEOUT_S, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("fleet", ["zenoh", "in_process"])
def test_a_scenario_that_a_behaviour_cannot_work_with_is_a_mistake_of_the_user(
    fleet: str, tmp_path: Path
) -> None:
    code = "from agent import ParameterError\n\n" + PREAMBLE
    bad = "raise ParameterError('params.tries: must be 1 or more, is 0')"
    scenario = write_scenario(tmp_path, f"{code}\n\ndef bad(robot):\n    {bad}\n", TOML)
    out = tmp_path / "log.mcap"
    done = heliograph("run", scenario, "--fleet", fleet, "--out", out, "--json")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    told = done.stderr.strip().splitlines()[-1]
    assert told == f"heliograph: {scenario.stem}: params.tries: must be 1 or more, is 0 (as robot r01 found)"
    assert out.exists()
