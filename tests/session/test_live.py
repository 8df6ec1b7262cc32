"""The live view, met by a WebSocket client: the log's own bytes, also for who comes late."""

from __future__ import annotations

import base64
import json
import socket
import threading
import time
from pathlib import Path
from types import ModuleType

import pytest

from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult, topics
from picktree.logs.log_records import NodesMessage, TickMessage, decode
from picktree.logs.node_states import NodeStates
from picktree.logs.recording import Recorder
from picktree.session import LiveServer, RunRequest, Session, WallClockPacer
from picktree.world import PlanningScene

from .websocket import Client, Received

EXAMPLES = Path(__file__).parents[2] / "examples"


def port_of(view: LiveServer) -> int:
    return int(view.url.rsplit(":", 1)[1])


def run(out: Path, view: LiveServer | None = None) -> RunResult:
    request = RunRequest(EXAMPLES / "one_pick.yaml", backend="kinematic", out=out)
    return Session(request, observers=[view] if view else []).run()


def test_a_client_gets_the_logs_own_messages_and_the_digest_is_the_same(tmp_path: Path) -> None:
    with LiveServer(0, "one pick") as view, Client(port_of(view)) as client:
        fixed = [topic.name for topic in topics.FIXED]
        client.wait_for(fixed)
        client.subscribe(fixed)
        received: list[object] = []
        listener = threading.Thread(target=lambda: received.extend(client.rest()))
        listener.start()
        result = run(tmp_path / "live", view)
        patience = time.monotonic() + 300  # of a machine that has other things to do
        while client.clock != round(result.sim_seconds * 1e9) and time.monotonic() < patience:
            time.sleep(0.01)
        view.close()  # not before the client has heard all
        listener.join()
    assert client.info["name"] == "one pick" and "time" in client.info["capabilities"]
    assert client.clock == round(result.sim_seconds * 1e9)
    with RunLog(result.log) as log:
        recorded = [Received(m.topic, m.time, m.data) for m in log.messages(fixed)]
        assert {
            topic: (c["schemaName"], c["encoding"], c["schemaEncoding"])
            for topic, c in client.channels.items()
            if topic in fixed
        } == {t.name: (t.schema, t.encoding, t.schema_encoding) for t in topics.FIXED}
    key = str
    assert sorted(received, key=key) == sorted(recorded, key=key)
    assert len(recorded) > 500
    assert run(tmp_path / "silent").digest == result.digest


def test_the_schemas_are_those_of_the_log() -> None:
    with LiveServer(0) as view, Client(port_of(view)) as client:
        client.wait_for([topics.TICK.name, topics.TF.name])
    assert json.loads(client.channels["/bt/tick"]["schema"]) == json.loads(topics.TICK.schema_data())
    assert base64.b64decode(client.channels["/tf"]["schema"] + "==") == topics.TF.schema_data()


def test_who_comes_late_is_sent_what_still_holds(sample: ModuleType, tmp_path: Path) -> None:
    cameras = [f"/camera/overhead/{what}" for what in ("calibration", "colour", "depth")]
    states = ["/bt/tree", "/bt/nodes", "/scene/robot", "/scene/objects", "/truth/objects", "/tf", *cameras]
    passing = ["/events", "/log", "/plan", "/candidates", "/timing", "/wrench"]
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    with (
        LiveServer(0) as view,
        Recorder(tmp_path / "log.mcap", sample.RUN, listener=view.recorded) as recorder,
    ):
        sample.start(recorder)
        for k in range(45):
            sample.step(recorder, scene, k)
        with Client(port_of(view)) as client:  # while the run stands still
            client.wait_for([*states, "/bt/tick", *passing])
            client.subscribe([*states, *passing])
            received = client.messages(len(states))
            client.subscribe(["/bt/tick"])
            ticks = client.messages(5)  # those since the snapshot at 2.0 s
            assert client.clock == 2_200_000_000
            sample.step(recorder, scene, 45)
            (following,) = client.messages(1)  # and nothing of what is over
            assert following.time == 2_250_000_000
    with RunLog(tmp_path / "log.mcap") as log:
        for message in received:
            last = log.last(message.topic, 2.2)
            assert last is not None
            assert (message.time, message.data) == (last.time, last.data), message.topic
        assert {message.topic for message in received} == set(states)
        snapshot = next(message for message in received if message.topic == "/bt/nodes")
        nodes = NodeStates()
        nodes.take(decode(NodesMessage, snapshot.data).nodes)
        for message in ticks:
            last_states = nodes.after(decode(TickMessage, message.data).transitions)
        told = log.tick_at(2.2)
        assert told is not None and last_states == told.record.nodes


def test_a_client_that_does_not_listen_holds_up_nothing() -> None:
    with LiveServer(0) as view, Client(port_of(view), most=1) as client:
        client.wait_for([topic.name for topic in topics.FIXED])
        client.subscribe([topic.name for topic in topics.FIXED])
        payload = bytes(200_000)
        for k in range(1000):  # 200 MB, which no socket holds
            view.recorded(topics.ROBOT, k, payload, in_digest=True)


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PicktreeError) as raised:
            LiveServer(port)
    assert str(raised.value) == (
        f"no live view on port {port}: something else listens there; give another with --live-port"
    )


class Clock:
    def __init__(self) -> None:
        self.now, self.slept = 100.0, list[float]()

    def sleep(self, seconds: float) -> None:
        self.slept.append(round(seconds, 6))
        self.now += seconds


def test_the_pace_makes_up_for_slow_ticks_but_not_for_long_ones() -> None:
    clock = Clock()
    paced = WallClockPacer(2.0, clock=lambda: clock.now, sleep=clock.sleep)

    def tick(now: float, cost: float) -> None:
        clock.now += cost
        paced.ticked(now, None, 0, 0)  # type: ignore[arg-type]

    for k in range(20):
        tick(k * 0.1, 3.0 if k == 5 else 0.2 if k == 2 else 0.01)
    assert clock.slept[:1] == [0.04]  # 0.1 s at twice the speed, less what the tick cost
    assert sum(clock.slept) < 0.6
    tick(12.0, 0.01)
    assert clock.slept[-1] > 4.0


def test_the_pace_tells_gaps_at_which_a_watchdog_would_have_braked() -> None:
    clock = Clock()
    paced = WallClockPacer(2.0, 0.2, clock=lambda: clock.now, sleep=clock.sleep)
    for k in range(20):
        clock.now += {5: 0.16, 9: 0.09}.get(k, 0.01)
        paced.ticked(k * 0.05, None, 0, 0)  # type: ignore[arg-type]
    assert paced.lateness == (
        "pace: once the next tick came after more than 100 ms of wall time (at most 175 ms): "
        "the watchdog of a robot would have braked the arm"
    )
    quick = WallClockPacer(2.0, 0.2, clock=lambda: clock.now, sleep=clock.sleep)
    for k in range(20):
        quick.ticked(k * 0.05, None, 0, 0)  # type: ignore[arg-type]
    assert quick.lateness == ""
