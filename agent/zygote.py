"""The process all robot processes are forked from.

It has imported everything a robot needs and opened nothing: a fork takes a millisecond and shares
the parent's memory, while a fork after a Zenoh session was ever open would hang. It stands between
the broker and the robots: it is their parent, passes on their output, tells when one ends, and ends
them all, and removes the broker's socket folder, when the broker is gone.

Started by the broker with one end of a socket pair as its standard input.
"""

from __future__ import annotations

import contextlib
import gc
import os
import selectors
import shutil
import signal
import socket
import sys
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct, msgpack

from agent.endings import exit_code, one_line, sentence
from agent.parent import signal_at_death_of

MAX_CONTROL_BYTES = 180_000
"""A control message fits one datagram of the default socket buffer."""
OUTPUT_CHUNK_BYTES = 16_384
MAX_ERROR = 2000
"""Characters of an error text."""
ROBOTS_PER_SPAWN = 200
"""So many robots fit one control message, whatever they are called."""


class Prepare(Struct, tag="prepare"):
    """Import these behaviours; `folder`: where a scenario's own Python files are."""

    behaviours: list[str]
    folder: str | None


class Spawn(Struct, tag="spawn"):
    """Fork these robots (name, password), at most ROBOTS_PER_SPAWN; they connect to `endpoint`."""

    endpoint: str
    run: str
    robots: list[tuple[str, str]]


class Finish(Struct, tag="finish"):
    """Kill what has not ended by itself, then exit."""


class Prepared(Struct, tag="prepared"):
    """Everything is imported; or `error` tells why not."""

    error: str | None


class Spawned(Struct, tag="spawned"):
    """Process ids in the order of the robots."""

    pids: list[int]


class Exited(Struct, tag="exited"):
    """A robot process is gone: exit code, or minus the signal that killed it."""

    robot: str
    code: int


class Output(Struct, tag="output"):
    """Something a robot process wrote to standard output or standard error."""

    robot: str
    text: Annotated[bytes, Meta(max_length=OUTPUT_CHUNK_BYTES)]


ToZygote = Prepare | Spawn | Finish
FromZygote = Prepared | Spawned | Exited | Output
encode = msgpack.Encoder().encode
decode_to_zygote = msgpack.Decoder(ToZygote).decode
decode_from_zygote = msgpack.Decoder(FromZygote).decode


def yield_to_broker() -> None:
    """Everybody waits for the broker, so it goes first where processors are few (measured: a tenth)."""
    os.nice(10)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


class Zygote:
    """Serves one broker over one socket."""

    def __init__(self, control: socket.socket, socket_folder: Path) -> None:
        self._control = control
        self._socket_folder = socket_folder
        self._folder: Path | None = None
        self._robots: dict[int, str] = {}
        self._outputs: dict[int, str] = {}
        self._selector = selectors.DefaultSelector()
        self._wakeup, wakeup_write = socket.socketpair()
        self._wakeup_write = wakeup_write
        for end in (self._wakeup, wakeup_write):
            end.setblocking(False)
        self._broker = os.getppid()
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.signal(signal.SIGTERM, self._broker_may_be_gone)
        signal.set_wakeup_fd(wakeup_write.fileno(), warn_on_full_buffer=False)
        self._selector.register(control, selectors.EVENT_READ)
        self._selector.register(self._wakeup, selectors.EVENT_READ)

    def serve(self) -> None:
        """Handle requests and robots until the broker finishes or is gone."""
        try:
            while self._serve_once():
                pass
        finally:
            self._kill_all()

    def _serve_once(self) -> bool:
        for key, _ in self._selector.select():
            if key.fileobj is self._control:
                request = self._receive()
                if request is None:
                    self._clean_up_after_broker()
                    return False
                if not self._handle(request):
                    return False
            elif key.fileobj is self._wakeup:
                with contextlib.suppress(BlockingIOError):
                    self._wakeup.recv(4096)
                self._reap()
            elif key.fd in self._outputs:  # not one that a robot's end has just closed
                self._relay(key.fd)
        return True

    def _receive(self) -> ToZygote | None:
        """The next request, whose bytes nobody keeps: robots inherit what we remember."""
        message = self._control.recv(MAX_CONTROL_BYTES)
        return decode_to_zygote(message) if message else None

    def _broker_may_be_gone(self, *_: object) -> None:
        """The kernel says so also when only the broker's *thread* that started us has ended.

        An empty read says it as well, but not while a behaviour's import keeps us busy.
        """
        if os.getppid() != self._broker:
            self._clean_up_after_broker()
            os._exit(1)

    def _clean_up_after_broker(self) -> None:
        """It went without a word: end its robots, and remove what it would have removed."""
        self._kill_all()
        shutil.rmtree(self._socket_folder, ignore_errors=True)

    def _handle(self, request: ToZygote) -> bool:
        match request:
            case Prepare():
                self._tell(Prepared(self._prepare(request)))
            case Spawn():
                self._tell(Spawned([self._fork(request, *robot) for robot in request.robots]))
            case Finish():
                return False
        return True

    def _prepare(self, request: Prepare) -> str | None:
        from agent.link import emulated  # noqa: F401  (imported here once, for all robots)
        from agent.loading import BehaviourError, load_behaviour
        from agent.warm_up import warm_up

        self._folder = Path(request.folder) if request.folder is not None else None
        try:
            for behaviour in request.behaviours:
                load_behaviour(behaviour, self._folder)
        except BehaviourError as error:
            return one_line(str(error), MAX_ERROR)
        except BaseException as error:
            return f"importing the behaviour ended with {sentence(error)}"
        warm_up()
        gc.collect()
        gc.freeze()  # the collector then leaves shared pages alone
        return None

    def _fork(self, request: Spawn, robot: str, password: str) -> int:
        read_end, write_end = os.pipe()
        zygote = os.getpid()
        pid = os.fork()
        if pid == 0:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal_at_death_of(zygote, signal.SIGKILL)
            os.setpgid(0, 0)  # a group of its own, which ends with it: robots may start processes
            request.robots.clear()  # the others' passwords are not for this one
            self._become_robot(request, robot, password, write_end)
        os.close(write_end)
        os.set_blocking(read_end, False)
        self._robots[pid] = robot
        self._outputs[read_end] = robot
        self._selector.register(read_end, selectors.EVENT_READ)
        return pid

    def _become_robot(self, request: Spawn, robot: str, password: str, output: int) -> None:
        code = 1
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the broker decides when a run ends
            os.dup2(output, 1)
            os.dup2(output, 2)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.closerange(
                3, 1 + max(output, *self._outputs, self._selector.fileno(), self._wakeup_write.fileno())
            )
            sys.stdout = open(1, "w", buffering=1, closefd=False)  # noqa: SIM115
            sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
            yield_to_broker()
            from agent.link.emulated import run_robot

            run_robot(request.endpoint, request.run, robot, password, self._folder)
            code = 0
        except SystemExit as error:
            code = exit_code(error)
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            with contextlib.suppress(Exception):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)  # no exit handlers of the zygote run in a robot

    def _relay(self, output: int) -> None:
        try:
            text = os.read(output, OUTPUT_CHUNK_BYTES)
        except BlockingIOError:
            return
        if text:
            self._tell(Output(self._outputs[output], text))
        else:
            self._forget_output(output)

    def _forget_output(self, output: int) -> None:
        self._selector.unregister(output)
        os.close(output)
        del self._outputs[output]

    def _reap(self) -> None:
        while self._robots:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            robot = self._robots.pop(pid, None)
            if robot is not None:
                _kill_group(pid)
                self._drain_output(robot)
                self._tell(Exited(robot, os.waitstatus_to_exitcode(status)))

    def _drain_output(self, robot: str) -> None:
        """Its last words, so that they are known before its end is."""
        for output in [fd for fd, name in self._outputs.items() if name == robot]:
            while True:
                try:
                    text = os.read(output, OUTPUT_CHUNK_BYTES)
                except BlockingIOError:
                    break
                if not text:
                    break
                self._tell(Output(robot, text))
            self._forget_output(output)

    def _tell(self, message: FromZygote) -> None:
        with contextlib.suppress(
            BrokenPipeError, ConnectionResetError
        ):  # a broker that is gone shows as an empty read
            self._control.send(encode(message))

    def _kill_all(self) -> None:
        for pid in self._robots:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)  # by itself too: it may not have its group yet
            _kill_group(pid)
        for pid in list(self._robots):
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)
            del self._robots[pid]


def _kill_group(robot: int) -> None:
    """End whatever processes a robot has started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(robot, signal.SIGKILL)


def main() -> None:
    """Entry point: `python -m agent.zygote SOCKET_FOLDER`, control socket on standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    control = socket.socket(fileno=os.dup(0))
    zygote = Zygote(control, Path(sys.argv[1]))
    signal_at_death_of(os.getppid(), signal.SIGTERM)
    zygote.serve()


if __name__ == "__main__":
    main()
