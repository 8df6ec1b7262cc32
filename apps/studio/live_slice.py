"""Live slice: the calls with which the page starts runs, watches them and steers them."""

from __future__ import annotations

import asyncio
import os
import socket
import struct
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from picktree.files import PicktreeError
from picktree.logs.mcap import is_written
from picktree.session import attach_socket
from picktree.trees import PortDeclaration, show
from picktree.trees.loading import NodeRegistry, load_mission
from picktree.world.robot_model import robot_file
from picktree.world.scene import scene_loading

from .calls import JsonValue, call, watch
from .jobs import Job, job_text
from .slice import Slice, Studio
from .workspace import Workspace

if TYPE_CHECKING:
    from .followed_run import FollowedRun

MAX_SEED: Final = 2**31 - 1


class RunOrder(BaseModel):
    """Order for a run, from the page's form. Paths are below the folder."""

    model_config = ConfigDict(extra="forbid", strict=True)

    mission: str
    scene: str = ""
    """Shipped scene or scene file; empty: the mission's own."""
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 0
    parameters: Mapping[str, str] = Field(default_factory=dict[str, str])
    robot: str = ""
    """Shipped robot or robot file; empty: the scene's."""
    faults: str = ""
    backend: Literal["physics", "kinematic"] = "physics"
    pace: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Bound of simulated seconds per wall second; 0: as fast as possible."""
    watch: bool = True
    """Whether edits of the mission take over between two items."""


def start_form(workspace: Workspace, mission: str) -> JsonValue:
    """Return the possible settings of a run by its mission and folder. Raises PicktreeError with the file's
    faults."""
    loaded = load_mission(workspace.resolve(mission), NodeRegistry())
    files = workspace.files()
    return {
        "mission": mission,
        "scene": loaded.scene or "",
        "parameters": [_parameter(port) for port in loaded.parameters],
        "scenes": [*scene_loading.scene_names(), *(each.path for each in files if each.kind == "scene")],
        "robots": [*robot_file.robot_names(), *(each.path for each in files if each.kind == "robot")],
        "faults": [each.path for each in files if each.kind == "faults"],
    }


def _parameter(port: PortDeclaration) -> JsonValue:
    return {
        "name": port.key,
        "type": str(port.type),
        "unit": port.unit or "",
        "doc": port.doc,
        "required": port.required,
        "default": "" if port.required or port.default is None else show(port.default).strip("'"),
        "choices": [str(choice) for choice in port.choices or ()],
    }


def run_command(workspace: Workspace, order: RunOrder, runs: Path) -> list[str]:
    """Return the words after `picktree` for an order. Raises PicktreeError for a path outside the folder."""
    words = ["run", str(workspace.resolve(order.mission)), "--out", str(runs), "--seed", str(order.seed)]
    words += ["--backend", order.backend]
    if order.scene:
        words += ["--scene", _named(workspace, order.scene, scene_loading.scene_names())]
    if order.robot:
        words += ["--robot", _named(workspace, order.robot, robot_file.robot_names())]
    if order.faults:
        words += ["--faults", str(workspace.resolve(order.faults))]
    if order.pace > 0.0:
        words += ["--pace", f"{order.pace:g}"]
    words.append("--wait")  # a question waits for the page, also while no server is there
    if order.watch:
        words.append("--watch")
    for name, value in order.parameters.items():
        if "=" in name or name.startswith("-"):
            raise PicktreeError(f"{name!r} is not the name of a parameter")
        words += ["--set", f"{name}={value}"]
    return words


def _named(workspace: Workspace, name: str, shipped: tuple[str, ...]) -> str:
    """Return a shipped name unchanged, a file below the folder as its path."""
    if name in shipped:
        return name
    with suppress(PicktreeError):
        place = workspace.resolve(name)
        if place.is_file():
            return str(place)
    raise PicktreeError(f"{name!r} is neither shipped nor a file of the folder")


MAX_RUNS: Final = 4
"""Maximum number of concurrent runs of the folder."""
_LIVE: Final = "#/live/"
_ENDED: Final = "live.ended"
"""Name of the finisher of a run's job."""
_PERIOD: Final = 0.5
_START_TIME: Final = 120.0
"""Time for a new run to appear, wall s: a robot is read, and its meshes are made when they are new."""
_SKIPPED: Final = frozenset({"node_modules", "__pycache__"})
_MAX_DEPTH: Final = 3
"""Depth of folders below the studio's in which runs are looked for."""


class LiveSlice(Slice):
    """Calls on runs in progress. They are found by the sockets in their folders, whoever started them."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._jobs = studio.jobs
        self._jobs.finishers[_ENDED] = _show_as_kept
        self._followed: dict[str, FollowedRun] = {}
        self._beginning: dict[str, asyncio.Lock] = {}
        self._over: set[str] = set()
        """Folders of runs that have ended."""

    async def close(self) -> None:
        for run in self._followed.values():
            run.leave()

    @watch("live.runs")
    async def runs(self) -> AsyncIterator[JsonValue]:
        """Yield the folder's runs in progress, again whenever they change."""
        before: list[JsonValue] | None = None
        while True:
            now = await asyncio.to_thread(self._runs_in_progress)
            if now != before:
                yield now
                before = now
            await asyncio.sleep(_PERIOD)

    @call("live.form")
    async def form(self, mission: str) -> JsonValue:
        """Return the possible settings of a run by its mission and folder."""
        return await asyncio.to_thread(start_form, self._workspace, mission)

    @call("live.start")
    async def start(self, order: RunOrder) -> str:
        """Start a run in a process of its own; return its identity when it can be watched.

        Raises PicktreeError with what it wrote when it ends before.
        """
        if len(await asyncio.to_thread(self._runs_in_progress)) >= MAX_RUNS:
            raise PicktreeError(f"{MAX_RUNS} runs are in progress in this folder; wait for one, or halt one")
        runs = self._workspace.root / "runs"
        command = await asyncio.to_thread(run_command, self._workspace, order, runs)
        job = self._jobs.start(f"Run {order.mission}", command, keeps_on=True, finish=_ENDED)
        return await self._identity_of(job)

    async def _identity_of(self, job: Job) -> str:
        """Return the identity of the job's run when its socket is there."""
        end = time.monotonic() + _START_TIME
        while time.monotonic() < end:
            for found in await asyncio.to_thread(lambda: list(self._sockets())):
                if job.process and await asyncio.to_thread(_is_of, found, job.process.number):
                    identity = self._workspace.relative(found)
                    job.result = f"{_LIVE}{identity}"
                    self._jobs.write(job)
                    return identity
            if job.ended is not None:
                raise PicktreeError(job_text(job).strip()[-2000:] or "the run has ended at once")
            await asyncio.sleep(0.05)
        raise PicktreeError(f"the run has not begun within {_START_TIME:g} s")

    @watch("live.follow")
    async def follow(self, id: str) -> AsyncIterator[JsonValue]:
        """Yield everything about a run at first, then the changes, until it ends."""
        run = await self._run(id)
        async for event in run.events():
            yield event

    @call("live.stage")
    async def stage(self, id: str) -> str:
        """Return robot and fixed parts of a run for the 3-D view, packed."""
        run = await self._run(id)
        return await asyncio.to_thread(run.stage)

    @call("live.command")
    async def command(self, id: str, line: str) -> str:
        """Carry out a command of `picktree attach` in a run; return its output."""
        run = await self._run(id)
        return await run.command(line)

    @call("live.take")
    async def take(self, id: str, mission: str) -> str:
        """Let a mission of the folder take over between two items; return the run's message about it."""
        file = self._workspace.resolve(mission)
        run = await self._run(id)
        return await run.command(f"take {file}")

    async def _run(self, id: str) -> FollowedRun:
        """Return the run of an identity, connected. Raises PicktreeError when it is not in progress."""
        async with self._beginning.setdefault(id, asyncio.Lock()):
            known = self._followed.get(id)
            if known is None or known.ended:
                # It loads analysis, which a page without runs does not need.
                from .followed_run import FollowedRun

                known = FollowedRun(self._workspace.resolve(id))
                await known.begin()
                self._followed[id] = known
            return known

    def _runs_in_progress(self) -> list[JsonValue]:
        """Return the runs in progress, newest first."""
        found = [folder for folder in self._sockets() if any(map(is_written, folder.glob("*.mcap")))]
        found.sort(key=_began, reverse=True)
        return [{"id": self._workspace.relative(each), "began": _began(each)} for each in found]

    def _sockets(self) -> Iterator[Path]:
        """Yield the folders with a run's socket. A run that was seen to have ended is not looked at again."""
        todo = [(self._workspace.root, 0)]
        while todo:
            folder, depth = todo.pop()
            below: list[str] = []
            with suppress(OSError), os.scandir(folder) as entries:
                below = [entry.path for entry in entries if _may_hold_runs(entry)]
            for path in below if depth < _MAX_DEPTH else ():
                if path in self._over:
                    continue
                if os.path.lexists(f"{path}/{attach_socket.SOCKET_NAME}"):
                    yield Path(path)
                elif os.path.lexists(f"{path}/result.json"):
                    self._over.add(path)
                else:
                    todo.append((Path(path), depth + 1))


def _may_hold_runs(entry: os.DirEntry[str]) -> bool:
    hidden = entry.name.startswith(".") or entry.name in _SKIPPED
    return not hidden and entry.is_dir(follow_symlinks=False)


def _show_as_kept(job: Job) -> None:
    """Set the result of a run's job to the recorded run, when the run has ended."""
    if job.result.startswith(_LIVE):
        job.result = f"#/run/{job.result.removeprefix(_LIVE)}"


def _began(folder: Path) -> float:
    with suppress(OSError):
        return (folder / attach_socket.SOCKET_NAME).stat().st_mtime
    return 0.0


def _is_of(folder: Path, process: int) -> bool:
    try:
        with attach_socket.connect_to_run(folder) as connection:
            size = struct.calcsize("3i")
            found = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
            return found[0] == process
    except (PicktreeError, OSError):
        return False
