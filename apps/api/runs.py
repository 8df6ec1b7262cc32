"""Computation in a process of its own, where picktree chooses the kernels before numpy is loaded."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cached_property
from multiprocessing.connection import Connection, wait
from os import PathLike
from pathlib import Path
from typing import Literal, ParamSpec, TypeVar, cast

from picktree.analysis import Run
from picktree.apps.batch import die_with_parent, exit_code_words, without_main
from picktree.files import PicktreeError, departures, file_system
from picktree.files.yaml import read_document
from picktree.logs import RunResult, log_files
from picktree.robot.planning import has_second_core
from picktree.session import Execution, RunRequest, Session, run_recipe
from picktree.simulation import Backend
from picktree.trees import Node
from picktree.world import Plain

from .display import ReadableText, SceneImage, html_table
from .mission import Mission

P = ParamSpec("P")
T = TypeVar("T")


def in_clean_process(work: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
    """Return the result of a function of picktree that a new process calls; its arguments are pickled.

    An interrupt (SIGINT) is passed on, and the result is still waited for. Raises PicktreeError as the
    function does, and when the process ends without a result.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, work, arguments, options), name="picktree-run")
    with without_main():
        process.start()
    theirs.close()
    while True:
        try:
            wait([ours])
            break
        except KeyboardInterrupt:
            if process.pid is not None:
                os.kill(process.pid, signal.SIGINT)
    try:
        answer = cast("T | PicktreeError", ours.recv())
    except EOFError:
        process.join()
        words = exit_code_words(process.exitcode or 0)
        raise PicktreeError(f"the process of the run {words} without a result") from None
    process.join()
    if isinstance(answer, PicktreeError):
        raise answer
    return answer


def _serve(
    answers: Connection,
    work: Callable[..., object],
    arguments: tuple[object, ...],
    options: dict[str, object],
) -> None:
    os.setsid()  # Ctrl-C reaches the parent, which passes it on
    die_with_parent(signal.SIGTERM)
    try:
        answer = work(*arguments, **options)
    except PicktreeError as error:
        answer = error
    answers.send(answer)


class MissionRun(RunResult):
    """Result of one run, with analyses of its log.

    `status` is `success` when the goal is reached; `items`, `picks`, `failures` and `recoveries` are counts,
    `log` is the log's file. `record` has everything in the log: ticks, visits, plans, joint positions.
    """

    @classmethod
    def of(cls, result: RunResult) -> MissionRun:
        """Return the run of a result."""
        return cls(**{each.name: getattr(result, each.name) for each in fields(RunResult)})

    @cached_property
    def record(self) -> Run:
        """Recorded run, read from the log on request."""
        return Run(self.log)

    def explain(self, *, everything: bool = False, truth: bool | None = None) -> ReadableText:
        """Return the explanation of the run's end: root causes, failures, cures, items.

        `everything` describes each failure and each item separately. `truth`: the ground truth is used; None:
        where the log has it.
        """
        from picktree.analysis.explain import explain, to_text

        found = self.record.explanation if truth is None else explain(self.record, truth=truth)
        text = to_text(self.record, found, str(self.folder), everything=everything)
        return ReadableText(text)

    def show(
        self,
        at: float | None = None,
        *,
        size: tuple[int, int] = (960, 600),
        view: str = "corner",
        show: Literal["belief", "truth", "both"] = "belief",
    ) -> SceneImage:
        """Return a picture of the scene at a time, simulated s; by default of the end.

        `view` is a name such as `top`, or `AZIMUTH,ELEVATION,DISTANCE` in degrees and m; `both` draws the
        belief with outlines of the truth. Raises PicktreeError for a time outside the run.
        """
        time = self.record.end if at is None else at
        return SceneImage(self.record.picture(time, size, view=view, show=show))

    def report(self, file: str | PathLike[str]) -> Path:
        """Write the run as a page with a 3-D replay, and return its path."""
        from picktree.analysis.report import write_report

        write_report(self.record, Path(file))
        return Path(file)

    def __repr__(self) -> str:
        return self.to_text()

    def _repr_html_(self) -> str:
        items, picks = self.items, self.picks
        rows: list[tuple[str, object]] = [
            ("status", self.status + (f": {self.message}" if self.message else "")),
            ("seed", self.seed),
            ("items", items.to_text()),
            ("grasps", f"{picks.held} held of {picks.tried} tried"),
            ("simulated", f"{self.sim_seconds:.1f} s"),
            *((f"failure {cause}", count) for cause, count in self.failures.items()),
            ("log", self.log),
        ]
        return html_table(("run", ""), rows)


def run(
    mission: Mission | Node | str | PathLike[str],
    *,
    seed: int = 0,
    scene: str | PathLike[str] | None = None,
    robot: str | PathLike[str] | None = None,
    parameters: Mapping[str, Plain] | None = None,
    faults: str | PathLike[str] | None = None,
    backend: Backend = "physics",
    verify: bool = False,
    limit: float = run_recipe.DEFAULT_TIME_LIMIT,
    watch: bool = False,
    rotation: log_files.Rotation = log_files.NO_ROTATION,
    out: str | PathLike[str] | None = None,
) -> MissionRun:
    """Run a mission to its end, record it, and return its result.

    `mission` is a file, a shipped example, a `Mission`, or a tree of nodes; a tree needs `scene`. `scene` and
    `robot` are shipped ones or files, and replace the mission's. `parameters` are ports of `Main`, and ports
    of nodes as `{"Grasp.force": "20 N"}`. `backend` is `physics` or `kinematic`; `verify` checks every
    trajectory a second time; `limit` ends the run, simulated s; `watch` takes over edits of the file. The
    run's folder is made in `out`, by default `runs`. It is computed in another process where numpy was
    imported before picktree. Raises PicktreeError (FileError with all faults) for bad input.
    """
    if isinstance(mission, Node):
        mission = Mission(mission, name=mission.description.id)
    made = mission if isinstance(mission, Mission) and mission.file is None else None
    request = RunRequest(
        mission=made.place if made is not None else _file(mission),
        scene=str(scene) if scene is not None else None,
        robot=str(robot) if robot is not None else None,
        seed=seed,
        parameters={key: setting_text(value) for key, value in (parameters or {}).items()},
        faults=file_system.example_file(faults, "faults", "faults file") if faults is not None else None,
        out=Path(out) if out is not None else None,
        backend=backend,
        verify=verify,
        limit=limit,
        watch=watch,
        rotation=rotation,
    )
    if departures() and (made is None or made.is_complete_text):
        # most processes need none

        return MissionRun.of(
            in_clean_process(_computed_text, request, made.text if made is not None else None)
        )
    return MissionRun.of(_computed(request, made))


def _computed_text(request: RunRequest, text: str | None) -> RunResult:
    """Run a request; `text`: the mission that was made in Python, None: the request's file."""
    made = Mission(read_document(request.mission, "mission", text)) if text is not None else None
    return _computed(request, made)


def _computed(request: RunRequest, made: Mission | None) -> RunResult:
    if made is None:
        return Session(request, planning_worker=has_second_core()).run()
    execution = Execution(run_recipe.read_recipe(request, made.checked()), planning_worker=has_second_core())
    return Session(execution, record=run_recipe.Recording(request.out, request.rotation)).run()


def _file(mission: Mission | str | PathLike[str]) -> Path:
    path = mission.file if isinstance(mission, Mission) else mission
    assert path is not None
    return file_system.example_file(path)


def setting_text(value: Plain) -> str:
    """Return the value of a parameter as `--set` takes it."""
    if isinstance(value, list):
        return ",".join(map(setting_text, value))
    return str(value).lower() if isinstance(value, bool) else str(value)
