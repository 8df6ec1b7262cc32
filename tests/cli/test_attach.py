"""`picktree attach`: a run in one process, watched, steered and answered from others."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import stat
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.cli import answer
from picktree.logs import RunLog
from picktree.session import PresetAnswers, RunRequest, Session
from picktree.session.attach_socket import SOCKET_NAME, connect_to_run, listen_in, socket_address

from ..commands import PATIENCE, Command, Streams, Terminal, call, until

MISSION = """\
picktree: 1
kind: mission
name: asking
scene: sort_small
goal: sorted >= 0
trees:
  Main:
    Sequence:
      - GoTo: {pose: home, breakpoint: before}
      - Delay: {delay_msec: 2500 ms, do: AlwaysSuccess}
      - AskForHelp: {reason: "is it there?", choices: ["yes", "no"], give_up: "no", answer: "{answer}"}
      - GoTo: {pose: home, name: Back}
"""
ASK = "Main/Sequence/AskForHelp"


class Run:
    """`picktree run` of the mission in a process of its own, no faster than the clock."""

    def __init__(self, out: Path, *options: str, pace: str = "1") -> None:
        self.out = out
        out.mkdir(parents=True)
        (out / "asking.yaml").write_text(MISSION)
        words = ["run", str(out / "asking.yaml"), "--backend", "kinematic", "--out", str(out), *options]
        with (out / "said.txt").open("w") as said, open(os.devnull) as nothing:
            streams = Streams(nothing.fileno(), said.fileno(), said.fileno())
            self.command = Command([*words, "--pace", pace], streams)
        until(lambda: self.command.ended() or any(out.glob(f"*/{SOCKET_NAME}")), "the socket")
        (self.socket,) = out.glob(f"*/{SOCKET_NAME}")
        self.folder = self.socket.parent

    def result(self) -> dict[str, Any]:
        self.command.end()
        return json.loads((self.folder / "result.json").read_text())


class Client:
    """Attached process that speaks the protocol."""

    def __init__(self, folder: Path, *, steer: bool = True) -> None:
        self._connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._connection.settimeout(PATIENCE)
        with socket_address(folder) as address:
            self._connection.connect(address)
        self._lines = self._connection.makefile("r")
        self.send({"steer": steer})
        self.next("run")

    def send(self, message: object) -> None:
        self._connection.sendall(json.dumps(message).encode() + b"\n")

    def next(self, key: str) -> Any:
        """Return the next message of a kind."""
        for line in self._lines:
            message = json.loads(line)
            if key in message:
                return message[key]
        raise AssertionError(f"the connection ends before {key!r}")

    def ask(self, line: str) -> str:
        self.send({"line": line})
        return self.next("reply")

    def leave(self) -> None:
        self._lines.close()
        self._connection.close()


class Follower:
    """Attached process that follows the log."""

    def __init__(self, folder: Path) -> None:
        self._connection = connect_to_run(folder)
        self._connection.settimeout(PATIENCE)
        self._stream = self._connection.makefile("rb")
        self._connection.sendall(b'{"steer": false, "follow": true}\n')

    def take(self, seen: list[tuple[str, int, bytes]] | None = None) -> tuple[Any, list[bytes]]:
        """Return the next object with the payloads behind it; add messages that are new to `seen`."""
        while True:
            header = json.loads(self._stream.readline())
            messages = header.get("messages", ())
            payloads = [self._stream.read(size) for _, _, size in messages]
            if seen is not None and messages and "whole" not in header:
                seen += [(topic, at, data) for (topic, at, _), data in zip(messages, payloads, strict=True)]
            if not {"run", "state"} & set(header):
                return header, payloads

    def leave(self) -> None:
        self._stream.close()
        self._connection.close()


@contextmanager
def following(run: Run) -> Generator[Follower]:
    follower = Follower(run.folder)
    try:
        yield follower
    finally:
        follower.leave()


@contextmanager
def attached(run: Run, *, steer: bool = True) -> Generator[Client]:
    client = Client(run.folder, steer=steer)
    try:
        yield client
    finally:
        client.leave()


@pytest.fixture(scope="module")
def plain_digest(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Digest of the run that nobody attaches to, with the answer yes given in advance."""
    folder = tmp_path_factory.mktemp("plain")
    (folder / "asking.yaml").write_text(MISSION)
    request = RunRequest(mission=folder / "asking.yaml", backend="kinematic", out=folder)
    return Session(request, observers=[PresetAnswers(["yes"])]).run().digest


def test_a_script_pauses_steps_looks_and_answers_and_the_run_is_the_same(
    tmp_path: Path, plain_digest: str
) -> None:
    run = Run(tmp_path / ("long name " * 15))
    assert stat.S_IMODE(run.socket.stat().st_mode) == 0o600
    with attached(run) as holding, attached(run, steer=False) as watching:
        holding.ask("pause")
        stopped = watching.next("stop")
        lines = (
            "step 2", "step", "break AskForHelp", "continue", "node", "foo", "answer yes", "delete",
            "continue", "answer", "answer yes",
        )  # fmt: skip
        script = call(["attach", str(run.folder)], typed="\n".join(lines))
        assert script.returncode == 0, script.stderr
        said = script.stdout.replace("(picktree) ", "> ")
        now = [float(line.split()[0]) for line in said.splitlines() if line.endswith(" is RUNNING")]
        assert float(stopped.split()[0]) == now[0]
        assert now == pytest.approx([now[0], now[0] + 0.1, now[0] + 0.15])
        for part in (
            f"> break AskForHelp\n1: before {ASK}\n",
            f"s, before {ASK}\n> node\n{ASK}: AskForHelp, action, RUNNING\n",
            "> foo\nno command 'foo' (`help` lists the commands)\n",
            "> answer yes\nno question waits for an answer\n",
            "Help is wanted: is it there?\n",
            "> answer\n'' is not among the answers; write a number or one of these: yes, no\n",
        ):
            assert part in said
        assert watching.next("question")["choices"] == ["yes", "no"]
        assert watching.next("end") == "success"
    assert run.result()["digest"] == plain_digest
    assert not run.socket.exists()


def test_a_script_sends_no_line_before_the_reply_to_the_last_one(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").touch()
    script, said = tmp_path / "script.txt", tmp_path / "said.txt"
    script.write_text("step 2\nstep\n")
    with script.open() as typed, said.open("w") as out, closing(listen_in(tmp_path)) as listener:
        command = Command(["attach", str(tmp_path)], Streams(typed.fileno(), out.fileno(), out.fileno()))
        listener.setblocking(True)
        connection, _ = listener.accept()
        with closing(connection), connection.makefile("rw") as lines:

            def send(message: object) -> None:
                lines.write(json.dumps(message) + "\n")
                lines.flush()

            lines.readline()
            send({"run": str(tmp_path), "time": 0.1})
            assert json.loads(lines.readline()) == {"line": "step 2"}
            send({"stop": "the stop before it attached"})
            send({"told": "after the stop", "time": 0.1})
            until(lambda: "after the stop" in said.read_text(), "what the run tells")
            assert not select.select([connection], [], [], 0)[0]
            send({"reply": "", "goes_on": True})
            send({"stop": "the stop of the step"})
            assert json.loads(lines.readline()) == {"line": "step"}
            assert said.read_text().endswith("the stop of the step\n(picktree) step\n")
            send({"reply": "", "goes_on": True})
            assert command.end() == 0


def test_a_stop_lasts_as_long_as_somebody_who_steers(tmp_path: Path, plain_digest: str) -> None:
    run = Run(tmp_path / "runs", "--answer", "yes")
    with attached(run, steer=False) as watching:
        with attached(run) as one, attached(run) as other:
            assert other.ask("pause") == ""
            assert one.next("stop") == other.next("stop") == watching.next("stop")
            assert other.ask("pause") == "the run is stopped already\n"
            one.send(["nonsense"])  # its client is disconnected, the others stay
            assert one._lines.read().count("reply") == 0  # pyright: ignore[reportPrivateUsage]
            assert other.ask("print 1 + 1") == "2\n"
        assert watching.next("going")
        assert watching.next("end") == "success"
    assert run.result()["digest"] == plain_digest


def test_a_killed_client_harms_nothing_and_quit_ends_the_run(tmp_path: Path) -> None:
    run = Run(tmp_path / "runs", "--answer", "yes")
    words = ["attach", str(run.folder)]
    with attached(run, steer=False) as watching:
        terminal = Terminal(words)
        terminal.until("`help` for help")
        terminal.press(b"pause\n")
        terminal.until(", end of the tick;")
        watching.next("stop")
        os.kill(terminal._command.pid, signal.SIGKILL)  # pyright: ignore[reportPrivateUsage]
        assert watching.next("going")
        terminal.close()
    quitting = call(words, typed="quit\n")
    assert quitting.returncode == 0
    assert run.result()["status"] == "interrupted"
    assert run.command.end() == 130


def test_another_mission_takes_over_or_is_refused_and_the_arm_rests_after_halt(tmp_path: Path) -> None:
    run = Run(tmp_path / "runs")
    other = tmp_path / "other.yaml"
    other.write_text(
        MISSION.replace("      - GoTo: {pose: home, name: Back}", "      - Log: {message: taken}")
    )
    faulty = tmp_path / "faulty.yaml"
    faulty.write_text(MISSION.replace("AskForHelp", "AskForHelpp"))
    with attached(run) as steering:
        assert steering.ask("take") == "take what? A mission file, as 'take sort.yaml'\n"
        refused = steering.ask(f"take {faulty}")
        assert refused.startswith(f"the edit is not taken over:\n{faulty}:11:9: ")
        assert steering.ask(f"take {other}") == "the edit is good; it is taken over between two items\n"
        while not steering.next("told").startswith("the edited mission takes over: "):
            pass
        steering.next("question")
        steering.ask("answer yes")
        assert steering.next("end") == "success"
    with RunLog(run.folder) as log:
        events = [at.record.kind for at in log.events()]
    assert [kind for kind in events if kind in ("mission_edited", "log")] == ["mission_edited", "log"]
    halted = Run(tmp_path / "halted", pace="0.5")
    with attached(halted) as steering:
        steering.send({"line": "halt"})
        assert steering.next("end") == "interrupted"
    assert halted.command.end() == 130


def test_followers_receive_the_log_and_a_stop_within_a_tick(tmp_path: Path, plain_digest: str) -> None:
    run = Run(tmp_path / "runs", "--answer", "yes")
    with following(run) as follower, attached(run) as steering:
        header, _ = follower.take()
        assert header["whole"]
        assert "/bt/tree" in [topic for topic, _, _ in header["messages"]]
        steering.ask("break AskForHelp")
        seen: list[tuple[str, int, bytes]] = []
        statuses: dict[str, str] = {}
        while "stop" not in (header := follower.take(seen)[0]):
            statuses = header.get("statuses", statuses)
        assert (header["path"], statuses[ASK]) == (ASK, "RUNNING")
        steering.ask("set answer = no")
        while "statuses" not in (header := follower.take()[0]):
            pass
        assert header["blackboard"] == {"Main/answer": "no"}
        steering.ask("delete")
        steering.ask("continue")
        while "end" not in follower.take(seen)[0]:
            pass
    assert run.result()["digest"] != plain_digest  # its blackboard was changed
    with RunLog(run.folder) as log:
        topics = {topic for topic, _, _ in seen}
        first = min(at for topic, at, _ in seen if topic == "/bt/tick")
        recorded = [(m.topic, m.time, m.data) for m in log.messages(sorted(topics), first / 1e9 - 1e-6)]
    assert seen == [each for each in recorded if each[0] != "/timing"]


def test_a_run_that_does_not_go_on_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = Run(tmp_path / "runs")
    with attached(run, steer=False):
        os.kill(run.command.pid, signal.SIGKILL)
        run.command.end()
    assert run.socket.exists()
    assert answer(["attach", str(run.folder)]) == 2
    assert capsys.readouterr().err == f"{run.folder}: the run is not in progress\n"
    assert answer(["attach", str(tmp_path)]) == 2
    assert "there is no log.mcap in this folder" in capsys.readouterr().err
