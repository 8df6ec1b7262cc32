"""A studio that is served in this process, on a folder of the test."""

from __future__ import annotations

import asyncio
import http.client
import itertools
import json
import os
import threading
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import pytest
from websockets.sync.client import ClientConnection, connect

from picktree.apps.studio.server import link, listen, make_server
from picktree.apps.studio.workspace import Workspace
from picktree.trees.loading import PLUGINS_VARIABLE

from ..browser import Chromium, Told

T = TypeVar("T")
PATIENCE = 300.0
"""Wall seconds within which an answer comes, however busy the machine is."""


class Refused(Exception):
    """Answer of a call that is an error."""


@dataclass
class Client:
    """Conversation over the WebSocket, as the page has it."""

    socket: ClientConnection
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def call(self, name: str, **arguments: object) -> Any:
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "call": name, "with": arguments}))
        answer = self.answer(number)
        if "error" in answer:
            raise Refused(answer["error"]["message"])
        return answer["result"]

    def watch(self, name: str, **arguments: object) -> Iterator[Any]:
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "watch": name, "with": arguments}))
        while "event" in (answer := self.answer(number)):
            yield answer["event"]
        if "error" in answer:
            raise Refused(answer["error"]["message"])

    def answer(self, number: int | None) -> Any:
        while (message := json.loads(self.socket.recv(PATIENCE)))["id"] != number:
            pass
        return message


@dataclass
class Served:
    """A studio that answers."""

    folder: Path
    workspace: Workspace
    port: int
    link: str

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the page's own requests, its cookie included."""
        return {
            "Host": f"127.0.0.1:{self.port}",
            "Cookie": f"picktree_studio_{self.port}={self.workspace.state.token}",
        }

    def get(
        self,
        path: str,
        headers: Mapping[str, str] | None = None,
        method: str = "GET",
        body: bytes | None = None,
    ) -> tuple[int, Mapping[str, str], bytes]:
        """Return status, headers and content; `headers` are sent in place of the page's own."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in (self.headers if headers is None else headers).items():
                for one in value.split("\n"):
                    connection.putheader(name, one)
            if body is not None:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    @contextmanager
    def client(self, **headers: str) -> Iterator[Client]:
        origin = headers.pop("Origin", f"http://127.0.0.1:{self.port}")
        sent = {"Cookie": self.headers["Cookie"], **headers}
        address = f"ws://127.0.0.1:{self.port}/ws"
        with connect(address, origin=origin or None, additional_headers=sent, max_size=None) as socket:  # type: ignore[arg-type]
            yield Client(socket)


@contextmanager
def serving(folder: Path) -> Iterator[Served]:
    """Serve a folder in a thread. The state is in `XDG_STATE_HOME`, which the caller sets."""
    before = os.environ.get(PLUGINS_VARIABLE)
    workspace = Workspace(folder)
    with listen(0) as listening:
        server = make_server(workspace, listening)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        try:
            yield Served(folder, workspace, listening.getsockname()[1], link(workspace, listening))
        finally:
            server.should_exit = True
            thread.join(PATIENCE)
            os.environ.pop(PLUGINS_VARIABLE, None)
            if before is not None:
                os.environ[PLUGINS_VARIABLE] = before


@contextmanager
def opened(served: Served, chromium: Chromium) -> Iterator[tuple[Any, Told]]:
    """The studio in a browser, its start page open; what the page had to say."""
    with chromium.blank(f"http://127.0.0.1:{served.port}/") as (page, told):
        page.set_default_timeout(PATIENCE * 1000)
        page.goto(served.link)
        page.wait_for_selector("main h1, main h2")
        yield page, told


def on_a_loop(work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine in a thread of its own: the tests' browser has a loop in this one."""
    with ThreadPoolExecutor(1) as alone:
        return alone.submit(lambda: asyncio.run(work())).result()


@pytest.fixture
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home for states of this test alone."""
    home = tmp_path / "state"
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    return home


@pytest.fixture
def served(tmp_path: Path, state_home: Path) -> Iterator[Served]:
    """A studio on an empty folder."""
    folder = tmp_path / "folder"
    folder.mkdir()
    with serving(folder) as found:
        yield found
