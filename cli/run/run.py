"""picktree run"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import PicktreeError
from ..options import Backend, JsonResult, OtherRobot, RunsFolder, Seed, Verify
from ..terminal.output import end_with, keep_stdout, print_answer, program

if TYPE_CHECKING:
    from ...session.debugger import Debugger
    from ...session.observer import Observer


def run(
    context: typer.Context,
    mission: Annotated[
        Path | None, typer.Argument(metavar="MISSION", help="Mission file; not with --resume.")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Shipped scene or scene file, for the mission's own.")
    ] = None,
    robot: OtherRobot = None,
    seed: Seed = 0,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Parameter, or port as SortOne/Grasp.force."),
    ] = None,
    faults: Annotated[Path | None, typer.Option(metavar="FILE", help="Faults to inject.")] = None,
    out: RunsFolder = None,
    backend: Backend = "physics",
    verify: Verify = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Stop at the mission's breakpoints, and before the first node.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Take over an edited mission between two items.")
    ] = False,
    limit: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Simulated time after which the run is ended, as 90 min.",
            show_default="1 h; with --resume as before",
        ),
    ] = None,
    rotate_mb: Annotated[
        float, typer.Option(min=0.0, metavar="MB", help="Go on in a further file of the log at this size.")
    ] = 0.0,
    rotate_minutes: Annotated[
        float, typer.Option(min=0.0, metavar="MIN", help="The same after so many simulated minutes.")
    ] = 0.0,
    live: Annotated[
        bool,
        typer.Option("--live", help="Serve the log as it grows to Foxglove or Lichtblick, on this machine."),
    ] = False,
    live_port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="PORT", help="Of --live; 0: any that is free.")
    ] = 8765,
    pace: Annotated[
        float | None,
        typer.Option(metavar="FACTOR", help="Simulated time no faster than so many times the clock's."),
    ] = None,
    resume: Annotated[
        str | None,
        typer.Option(metavar="LOG", help="Go on with this run: a log file, a run's folder, or 'last'."),
    ] = None,
    as_it_stands: Annotated[
        bool,
        typer.Option(
            "--as-it-stands",
            help="With --resume: as things stood last, knowing what was known at the checkpoint; look first.",
        ),
    ] = False,
    answers: Annotated[
        list[str] | None,
        typer.Option("--answer", metavar="TEXT", help="What is answered when the mission asks for help."),
    ] = None,
    json: JsonResult = False,
) -> None:
    """Run a mission in simulation, or go on with a run that did not come to its end. Exit code 0: the goal is
    reached; 1: it is missed, or the run is paused because the mission asks for help."""
    if resume is not None:
        refuse_contradictions(context)
    elif as_it_stands:
        raise PicktreeError("--as-it-stands is said of a run that goes on: give --resume LOG, too")
    elif mission is None:
        context.fail("Missing argument 'MISSION'.")
    answer = keep_stdout() if json else None
    parameters = parse_parameters(set_ or ())
    if pace is not None and pace <= 0:
        raise PicktreeError(f"--pace {pace:g}: write a number above 0, as in --pace 1 for real time")
    seconds = None if limit is None else parse_limit(limit)

    from ...logs.recording.rotated_log import Rotation
    from ...session.observer import PresetAnswers, WallClockPacer
    from ...session.recipe import DEFAULT_TIME_LIMIT
    from ...session.session import RunRequest, Session
    from ..terminal.progress import run_display
    from .operator_prompt import operators

    rotation = Rotation(round(rotate_mb * 1e6), rotate_minutes * 60.0)
    with ExitStack() as stack:
        resumption = None
        if resume is not None:
            from ...session.resume.resumption import ResumeRequest, Resumption

            asked = ResumeRequest(resume, out, seconds, rotation, as_it_stands, tuple(answers or ()))
            resumption = stack.enter_context(Resumption(asked))
            print(resumption.told, file=sys.stderr, flush=True)
        view = stack.enter_context(run_display(to_stderr=json, lines=debug))
        observers: list[Observer] = [view, *stack.enter_context(_live_view(live, live_port))]
        if pace is not None:
            observers.append(WallClockPacer(pace))
        if debug:
            observers.append(_debugger(to_stderr=json))
        people = operators(sys.stderr if json else sys.stdout, view.aside)
        if resumption is not None:
            session = resumption.session((*observers, *people))
        else:
            assert mission is not None
            request = RunRequest(
                mission=mission,
                scene=scene,
                robot=robot,
                seed=seed,
                parameters=parameters,
                faults=faults,
                out=out,
                backend=backend,
                verify=verify,
                watch=watch,
                limit=DEFAULT_TIME_LIMIT if seconds is None else seconds,
                rotation=rotation,
            )
            session = Session(request, observers=(*observers, PresetAnswers(answers or ()), *people))
        result = session.run()
    print_answer(answer, lambda: result.to_text(program()), result.to_json_text)
    end_with(result.reached, result.status)


_RECORDED_OPTIONS = ("mission", "scene", "robot", "seed", "set_", "faults", "backend", "verify", "watch")
"""Parameters that are invalid with --resume, because the log has them."""


def refuse_contradictions(context: typer.Context) -> None:
    """Raise PicktreeError for an option that the run's log already determines."""
    for name in _RECORDED_OPTIONS:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            shown = "MISSION" if name == "mission" else f"--{name.rstrip('_')}"
            raise PicktreeError(
                f"--resume and {shown} exclude each other: mission, scene, robot, seed, parameters, faults "
                "and backend are those of the run that goes on (`picktree whatif` changes some of them)"
            )


def parse_parameters(settings: list[str] | tuple[str, ...]) -> dict[str, str]:
    """`["a=1"]` → `{"a": "1"}`. Raises PicktreeError for one without a name or given twice.

    >>> parse_parameters(["colour=red", "rule=a=b"])
    {'colour': 'red', 'rule': 'a=b'}
    """
    parameters: dict[str, str] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        name = name.strip()
        if not equals or not name:
            raise PicktreeError(f"--set {setting}: write NAME=VALUE, as in --set colour=red")
        if name in parameters:
            raise PicktreeError(f"--set {setting}: {name!r} is set twice")
        parameters[name] = value
    return parameters


def parse_limit(text: str) -> float:
    """Simulated s. Raises PicktreeError for what is no time, or none at all.

    >>> parse_limit("90 min")
    5400.0
    """
    from ...files.quantities import parse_quantity

    try:
        seconds = parse_quantity(text, "s")
    except ValueError as error:
        raise PicktreeError(f"--limit {text}: {error}") from None
    if seconds <= 0:
        raise PicktreeError(f"--limit {text}: write a time above 0, as in --limit '90 min'")
    return seconds


@contextmanager
def _live_view(wanted: bool, port: int) -> Generator[tuple[Observer, ...]]:
    """Serve the live view in the block, if it is wanted; its address goes to stderr."""
    if not wanted:
        yield ()
        return
    from ...logs.optional_libraries import optional_import

    with optional_import("live", "foxglove", "A live view"):
        from ...session.live_view import LiveServer
    with LiveServer(port) as live_view:
        print(f"live view at {live_view.url}", file=sys.stderr, flush=True)
        yield (live_view,)


def _debugger(*, to_stderr: bool) -> Debugger:
    from ...session.debugger import Debugger
    from .operator_prompt import debug_prompt

    return Debugger(debug_prompt(sys.stderr if to_stderr else sys.stdout))
