"""Live slice: runs that are started, found, watched and steered, over its calls and watches."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import pytest

from picktree.apps.studio import followed_run
from picktree.apps.studio.jobs import Jobs
from picktree.apps.studio.live_slice import LiveSlice, RunOrder
from picktree.apps.studio.slice import Studio
from picktree.apps.studio.workspace import Workspace
from picktree.files import PicktreeError
from picktree.session.attach_socket import SOCKET_NAME, connect_to_run
from picktree.world.robot_model.robot_file import robot_names

from .conftest import PATIENCE, on_a_loop

T = TypeVar("T")

MISSION = """\
picktree: 1
kind: mission
name: asking
scene: sort_small
goal: sorted >= 0
trees:
  Main:
    ports: {rounds: {type: int, default: 40, doc: number of pauses}}
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - Delay: {name: Wait, delay_msec: 4 s, do: AlwaysSuccess}
      - Repeat: {num_cycles: "{rounds}", do: {Delay: {delay_msec: 100 ms, do: AlwaysSuccess}}}
      - AskForHelp: {reason: "is it there?", choices: ["yes", "no"], give_up: "no", answer: "{answer}"}
      - Log: {message: answered, value: "{answer}"}
"""


class Page:
    """Page that follows one run: its events put together."""

    def __init__(self, live: LiveSlice, identity: str) -> None:
        self.live, self.identity = live, identity
        self.state: dict[str, Any] = {}
        self.lags: list[float] = []
        self._events: AsyncIterator[Any] = live.follow(identity)

    async def until(self, holds: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Take events until the state fulfils a condition; return it."""
        async with asyncio.timeout(PATIENCE):
            while not holds(self.state):
                self._take(await anext(self._events))
        return self.state

    def _take(self, event: dict[str, Any]) -> None:
        for name, value in event.items():
            if name in ("nodes", "board", "frames", "looks", "images") and not event.get("whole"):
                self.state.setdefault(name, {}).update(value)
            elif name in ("rows", "lines", "transitions") and not event.get("whole"):
                self.state.setdefault(name, []).extend(value)
            else:
                self.state[name] = value

    async def leave(self) -> None:
        close: Callable[[], Awaitable[None]] = self._events.aclose  # type: ignore[attr-defined]
        await close()

    async def say(self, line: str) -> str:
        return await self.live.command(self.identity, line)


def stopped_at_node(state: dict[str, Any]) -> bool:
    stop = state.get("stop")
    return stop is not None and stop["path"] != ""


class Room:
    """Studio of a folder with the mission, without a server around it."""

    def __init__(self, folder: Path) -> None:
        (folder / "asking.yaml").write_text(MISSION)
        self.folder = folder
        self._workspace = Workspace(folder)

    def open(self) -> LiveSlice:
        return LiveSlice(Studio(self._workspace, Jobs(self._workspace)))


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Room]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "cell").mkdir()
    yield Room(tmp_path / "cell")
    end_runs(tmp_path / "cell")


def end_runs(folder: Path) -> None:
    """Interrupt the runs of a folder that a test has left, which would wait for answers."""
    for left in folder.glob(f"runs/*/{SOCKET_NAME}"):
        with suppress(PicktreeError, ConnectionError), connect_to_run(left.parent) as connection:
            connection.sendall(b'{"steer": true}\n{"line": "quit"}\n')
            while connection.recv(1 << 16):
                pass


ORDER = RunOrder(mission="asking.yaml", backend="kinematic", pace=2.0)


def test_a_run_is_started_steered_left_and_found_again_by_another_server(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def first() -> str:
        live = room.open()
        identity = await live.start(ORDER)
        page, other = Page(live, identity), Page(live, identity)
        await page.until(lambda s: s.get("belief") and s.get("frames"))
        assert [node["path"] for node in page.state["tree"]][:2] == ["Main", "Main/Sequence"]
        assert page.state["run"]["mission"] == "asking"
        await page.say("pause")
        assert await live.stage(identity)
        assert await page.say("break Repeat") == "1: before Main/Sequence/Repeat\n"
        await page.say("continue")
        stopped = await page.until(stopped_at_node)
        assert stopped["stop"]["path"] == "Main/Sequence/Repeat"
        assert stopped["breakpoints"] == [{"number": 1, "path": "Main/Sequence/Repeat", "when": "before"}]
        assert stopped["nodes"]["Main/Sequence/Repeat"][0] == "RUNNING"
        assert (await other.until(stopped_at_node))["stop"] == stopped["stop"]
        said = await page.say("set rounds = 2")
        assert said == "Main/rounds is set to 2 by the operator; it was 40\n"
        await other.until(lambda s: s["board"].get("Main/rounds") == 2)
        assert (await page.say("set rounds = two")).startswith("Main/rounds: 'two' is not a whole number")
        await page.say("step")
        await page.until(lambda s: s["stop"] and not s["stop"]["path"])
        started = [passed[1] for passed in page.state["transitions"] if passed[2] == "RUNNING"]
        assert started.count("Main/Sequence/Repeat") == 1
        await page.leave()
        await other.leave()
        await live.close()  # The server ends while the run stands.
        return identity

    async def second(identity: str) -> None:
        live = room.open()
        found = await anext(live.runs())
        assert isinstance(found, list)
        assert [each["id"] for each in found] == [identity]
        page = Page(live, identity)
        await page.until(lambda s: s.get("board", {}).get("Main/rounds") == 2)
        await page.say("delete")
        asked = await page.until(lambda s: s.get("question"))
        assert asked["question"]["choices"] == ["yes", "no"]
        faulty = room.folder / "faulty.yaml"
        faulty.write_text(MISSION.replace("Observe", "Obzerve"))
        assert "faulty.yaml:10:9: error" in await live.take(identity, "faulty.yaml")
        await page.say("answer yes")
        ended = await page.until(lambda s: s.get("ended"))
        assert (ended["status"], ended["board"]["Main/answer"]) == ("success", "yes")
        assert any(line[1] == "blackboard_set" for line in ended["lines"])
        with pytest.raises(PicktreeError, match="is not in progress"):
            await live.command(identity, "pause")
        await live.close()

    identity = on_a_loop(first)
    monkeypatch.setattr(followed_run, "HISTORY", 0.0)  # lines are known from the beginning on
    on_a_loop(lambda: second(identity))
    result = json.loads((room.folder / identity / "result.json").read_text())
    assert result["status"] == "success"


def test_the_form_offers_what_the_mission_takes_and_faults_are_named(room: Room) -> None:
    async def body() -> None:
        live = room.open()
        form: Any = await live.form("asking.yaml")
        assert form["parameters"] == [
            {
                "name": "rounds", "type": "int", "unit": "", "doc": "number of pauses", "required": False,
                "default": "40", "choices": [],
            }
        ]  # fmt: skip
        assert (form["scene"], "sort_small" in form["scenes"], form["robots"][:1]) == (
            "sort_small",
            True,
            [robot_names()[0]],
        )
        for order, told in (
            (ORDER.model_copy(update={"mission": "../elsewhere.yaml"}), "not below the folder"),
            (ORDER.model_copy(update={"scene": "nowhere"}), "neither shipped nor a file"),
            (ORDER.model_copy(update={"parameters": {"rounds": "many"}}), "'many' is not a whole number"),
        ):
            with pytest.raises(PicktreeError, match=told):
                await live.start(order)
        with pytest.raises(PicktreeError, match="is not in progress"):
            await anext(live.follow("elsewhere"))

    on_a_loop(body)


def test_runs_at_once_are_limited_and_halt_ends_one(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("picktree.apps.studio.live_slice.MAX_RUNS", 1)

    async def body() -> None:
        live = room.open()
        identity = await live.start(ORDER)
        with pytest.raises(PicktreeError, match="1 runs are in progress"):
            await live.start(ORDER)
        page = Page(live, identity)
        await page.until(lambda s: s.get("time", 0) > 0)
        await page.say("halt")
        assert (await page.until(lambda s: s.get("ended")))["status"] == "interrupted"
        await live.close()

    on_a_loop(body)
