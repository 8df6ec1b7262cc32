"""picktree run"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO, TypeAlias

import typer

from picktree.files import PicktreeError

from .options import (
    Backend,
    HelpGroups,
    JsonResult,
    OtherRobot,
    RunsFolder,
    Seed,
    Verify,
    faults_file,
    mission_file,
)
from .output import end_with, keep_stdout, print_answer, program

if TYPE_CHECKING:
    from cProfile import Profile

    from picktree.logs import log_files
    from picktree.session import Debugger, Observer, RunRequest, Session, WallClockPacer

    Assembly: TypeAlias = Callable[[Sequence[Observer]], Session]
    """Function that builds the session for its observers."""

MissionFile: TypeAlias = Annotated[
    Path | None,
    typer.Argument(
        metavar="MISSION", help="Mission file, or a shipped example; not with --resume.", parser=mission_file
    ),
]
OtherScene: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="SCENE", help="Shipped scene or scene file that replaces the mission's own."),
]
Settings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Value of a parameter, or of a node's port, as SortOne/Grasp.force=20.",
    ),
]
FaultsFile: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Faults to inject.", parser=faults_file)
]
Debug: TypeAlias = Annotated[
    bool, typer.Option("--debug", help="Stop at the mission's breakpoints, and before the first node.")
]
Watch: TypeAlias = Annotated[
    bool, typer.Option("--watch", help="Take over an edited mission between two items.")
]
TimeLimit: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="TIME",
        help="Simulated time after which the run is ended, as 90 min.",
        show_default="1 h; with --resume the limit of the resumed run",
    ),
]
RotateMegabytes: TypeAlias = Annotated[
    float, typer.Option(min=0.0, metavar="MB", help="Size at which the log continues in a further file.")
]
RotateMinutes: TypeAlias = Annotated[
    float,
    typer.Option(
        min=0.0, metavar="MIN", help="Simulated minutes after which the log continues in a further file."
    ),
]
Live: TypeAlias = Annotated[
    bool, typer.Option("--live", help="Serve the log as it grows to Foxglove or Lichtblick, on this machine.")
]
LivePort: TypeAlias = Annotated[
    int, typer.Option(min=0, max=65535, metavar="PORT", help="Port of --live; 0: any free port.")
]
Pace: TypeAlias = Annotated[
    float | None,
    typer.Option(metavar="FACTOR", help="Maximum ratio of simulated time to wall time."),
]
ResumedLog: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="LOG", help="Run to resume: a log file, a run's folder, or 'last'."),
]
AsItStands: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--as-it-stands",
        help="With --resume: start from the simulation's last state and the checkpoint's belief; "
        "the robot looks first.",
    ),
]
Wait: TypeAlias = Annotated[
    bool, typer.Option("--wait", help="Wait for `picktree attach` when the mission asks for help.")
]
ProfileFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Print the functions that take most wall time; FILE gets all of them, for pstats or snakeviz.",
    ),
]
RobotAt: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Run on the robot whose process listens there: a Unix socket, or 127.0.0.1:PORT.",
        show_default="a simulation",
    ),
]
Speed: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="SHARE",
        help="With --robot-at: share of the joints' speeds, as 10%. The robot's side stops beyond it.",
    ),
]
Confirm: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--confirm",
        help="With --robot-at: ask before each motion of the arm, here or in `picktree attach`.",
    ),
]
Shadow: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--shadow",
        help="With --robot-at: only read the robot, and show what would be sent.",
    ),
]
PerceptionAt: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="With --robot-at: let the process that listens there recognise the items.",
        show_default="items are recognised by colour",
    ),
]
Answers: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--answer", metavar="TEXT", help="Answer when the mission asks for help."),
]

HELP_GROUPS: HelpGroups = {
    "Mission and scene": ("scene", "robot", "seed", "set_", "faults", "backend", "verify"),
    "A robot in another process": ("robot_at", "perception_at", "speed", "shadow", "confirm"),
    "Time limit and log": ("limit", "out", "rotate_mb", "rotate_minutes"),
    "Watching and steering": ("debug", "watch", "live", "live_port", "pace", "answers", "wait"),
    "Resuming a run": ("resume", "as_it_stands"),
    "Output": ("profile", "json"),
}


def run(
    context: typer.Context,
    mission: MissionFile = None,
    scene: OtherScene = None,
    robot: OtherRobot = None,
    seed: Seed = 0,
    set_: Settings = None,
    faults: FaultsFile = None,
    out: RunsFolder = None,
    backend: Backend = "physics",
    robot_at: RobotAt = "",
    perception_at: PerceptionAt = "",
    speed: Speed = "100%",
    shadow: Shadow = False,
    confirm: Confirm = False,
    verify: Verify = False,
    debug: Debug = False,
    watch: Watch = False,
    limit: TimeLimit = None,
    rotate_mb: RotateMegabytes = 0.0,
    rotate_minutes: RotateMinutes = 0.0,
    live: Live = False,
    live_port: LivePort = 8765,
    pace: Pace = None,
    resume: ResumedLog = None,
    as_it_stands: AsItStands = False,
    answers: Answers = None,
    wait: Wait = False,
    profile: ProfileFile = None,
    json: JsonResult = False,
) -> None:
    """Run a mission in simulation, or resume an unfinished run. Exit code 0: the goal is reached; 1: it is
    missed, or the run is paused because the mission asks for help."""
    refuse_contradictions(context)
    answer = keep_stdout() if json else None
    parameters = parse_parameters(set_ or ())
    pacer = None if pace is None else _pacer(pace)
    seconds = None if limit is None else parse_limit(limit)
    measured = nullcontext() if profile is None else new_profile(profile)
    watchers = _Watchers(debug, live_port if live else None, pacer, wait, to_stderr=json)
    rotation = _rotation(rotate_mb, rotate_minutes)
    if resume is not None:
        assembly = _resumed_run(resume, out, seconds, rotation, answers or (), as_it_stands)
    else:
        from picktree.session import RunRequest

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
            rotation=rotation,
            robot_at=robot_at,
            perception_at=perception_at,
            speed=parse_share(speed),
            shadow=shadow,
            confirm=confirm,
            **({} if seconds is None else {"limit": seconds}),
        )
        assembly = _new_run(request, answers or ())
    with assembly as session_for, watchers.observers() as observers:
        session = session_for(observers)
        with measured as functions:
            result = session.run()
    watchers.print_lateness()
    print_answer(answer, lambda: result.to_text(program()), result.to_json_text)
    if profile is not None and functions is not None:
        write_profile(functions, profile, sys.stderr if json else sys.stdout)
    end_with(result.reached, result.status)


@contextmanager
def _new_run(request: RunRequest, answers: Sequence[str]) -> Generator[Assembly]:
    """Assemble the session of a run from its beginning."""
    from picktree.robot.planning import has_second_core
    from picktree.session import PresetAnswers, Session

    yield lambda observers: Session(
        request, observers=(PresetAnswers(answers), *observers), planning_worker=has_second_core()
    )


@contextmanager
def _resumed_run(
    log: str,
    out: Path | None,
    limit: float | None,
    rotation: log_files.Rotation,
    answers: Sequence[str],
    as_it_stands: bool,
) -> Generator[Assembly]:
    """Assemble the session that resumes a run; print where it resumes."""
    from picktree.session import ResumeRequest, Resumption

    request = ResumeRequest(log, out, limit, rotation, as_it_stands, tuple(answers))
    with Resumption(request) as resumption:
        print(resumption.description, file=sys.stderr, flush=True)
        yield resumption.session


@dataclass(frozen=True)
class _Watchers:
    """Options for the observers of a run at the command line."""

    debug: bool
    live_port: int | None
    """Port of the live view; None: no live view."""
    pacer: WallClockPacer | None
    """Upper bound of simulated seconds per wall second; None: as fast as possible."""
    wait: bool
    """Whether questions wait for an attached process."""
    to_stderr: bool
    """Whether stdout belongs to the result alone."""

    @contextmanager
    def observers(self) -> Generator[tuple[Observer, ...]]:
        """Return the observers; displays and servers are open in the block."""
        from .attach_server import AttachServer
        from .progress import operators, run_display

        with (
            run_display(to_stderr=self.to_stderr, lines=self.debug) as view,
            self._live_view() as live,
            AttachServer(waits=self.wait) as attached,
        ):
            yield (
                view,
                *live,
                *([self.pacer] if self.pacer is not None else ()),
                *([self._debugger()] if self.debug else ()),
                attached,
                *operators(self._stream, view.aside),
            )

    @contextmanager
    def _live_view(self) -> Generator[tuple[Observer, ...]]:
        """Serve the live view in the block, if it is wanted; its address goes to stderr."""
        if self.live_port is None:
            yield ()
            return
        from picktree.logs import optional_import

        with optional_import("live", "foxglove", "A live view"):
            from picktree.session import LiveServer
        with LiveServer(self.live_port) as live_view:
            print(f"live view at {live_view.url}", file=sys.stderr, flush=True)
            yield (live_view,)

    def print_lateness(self) -> None:
        """Print how far the run stayed behind its pace, if it did."""
        if self.pacer is not None and self.pacer.lateness:
            print(self.pacer.lateness, file=sys.stderr)

    def _debugger(self) -> Debugger:
        from picktree.session import Debugger

        from .debug_prompt import debug_prompt

        return Debugger(debug_prompt(self._stream))

    @property
    def _stream(self) -> TextIO:
        return sys.stderr if self.to_stderr else sys.stdout


_PROFILED_FUNCTIONS = 20
"""Number of functions in each table of a profile."""
_RECORDED_OPTIONS = (
    "mission", "scene", "robot", "seed", "set_", "faults", "backend", "robot_at", "perception_at", "speed",
    "shadow", "confirm", "verify", "watch",
)  # fmt: skip
"""Parameters that are invalid with --resume, because the log has them."""


def refuse_contradictions(context: typer.Context) -> None:
    """Raise for options that do not go together: PicktreeError; a usage error when the mission is missing.

    An option that the resumed run's log determines excludes --resume.
    """
    given = context.get_parameter_source("backend")
    if context.params["robot_at"] and given is not None and given.name == "COMMANDLINE":
        raise PicktreeError("--robot-at and --backend exclude each other: a robot is no simulation")
    if not context.params["robot_at"]:
        for name in ("perception_at", "speed", "shadow", "confirm"):
            source = context.get_parameter_source(name)
            if source is not None and source.name == "COMMANDLINE":
                option = name.replace("_", "-")
                raise PicktreeError(f"--{option} is for a robot: give --robot-at ADDRESS, too")
    if context.params["resume"] is None:
        if context.params["as_it_stands"]:
            raise PicktreeError("--as-it-stands needs a run to resume: give --resume LOG, too")
        if context.params["mission"] is None:
            context.fail("Missing argument 'MISSION'.")
        return
    for name in _RECORDED_OPTIONS:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            shown = "MISSION" if name == "mission" else f"--{name.rstrip('_').replace('_', '-')}"
            raise PicktreeError(
                f"--resume and {shown} exclude each other: mission, scene, robot, seed, parameters, faults "
                "and backend are those of the resumed run (`picktree whatif` changes some of them)"
            )


def _rotation(megabytes: float, minutes: float) -> log_files.Rotation:
    from picktree.logs import log_files

    return log_files.Rotation(round(megabytes * 1e6), minutes * 60.0)


def new_profile(file: Path) -> Profile:
    """Return an empty profile. Raises PicktreeError when its file cannot be written."""
    import cProfile

    folder = file.absolute().parent
    if file.is_dir():
        raise PicktreeError(f"{file}: the profile cannot be written: it is a folder")
    if not folder.is_dir():
        raise PicktreeError(f"{file}: the profile cannot be written: there is no folder {folder}")
    if not os.access(file if file.exists() else folder, os.W_OK):
        raise PicktreeError(f"{file}: the profile cannot be written: permission denied")
    return cProfile.Profile()


def write_profile(functions: Profile, file: Path, stream: TextIO) -> None:
    """Write the functions of a run into a file for `pstats`; print the dearest by own and by cumulative time.

    Raises PicktreeError when the disk refuses.
    """
    import pstats

    try:
        functions.dump_stats(file)
    except OSError as error:
        raise PicktreeError(f"{file}: the profile cannot be written: {error.strerror}") from None
    table = pstats.Stats(functions, stream=stream).strip_dirs()
    for order in ("tottime", "cumulative"):
        table.sort_stats(order).print_stats(_PROFILED_FUNCTIONS)


def parse_parameters(settings: list[str] | tuple[str, ...]) -> dict[str, str]:
    """Return `{"a": "1"}` for `["a=1"]`. Raises PicktreeError for a missing or repeated name.

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


def _pacer(factor: float) -> WallClockPacer:
    """Return the observer that keeps the pace. Raises PicktreeError unless the factor is above 0."""
    if factor <= 0:
        raise PicktreeError(f"--pace {factor:g}: write a number above 0, as in --pace 1 for real time")
    from picktree.robot.control import MAX_UNATTENDED_MOTION
    from picktree.session import WallClockPacer

    return WallClockPacer(factor, MAX_UNATTENDED_MOTION)


def parse_share(text: str) -> float:
    """Return a share in (0, 1]. Raises PicktreeError for any other text.

    >>> parse_share("10%")
    0.1
    """
    from picktree.files import quantities

    try:
        share = quantities.parse_quantity(text, "")
    except ValueError as error:
        raise PicktreeError(f"--speed {text}: {error}") from None
    if not 0.0 < share <= 1.0:
        raise PicktreeError(f"--speed {text}: write a share above 0 and at most 100%, as in --speed 10%")
    return share


def parse_limit(text: str) -> float:
    """Return a limit in simulated s. Raises PicktreeError for a text that is no time, or for no limit at all.

    >>> parse_limit("90 min")
    5400.0
    """
    from picktree.files import quantities

    try:
        seconds = quantities.parse_quantity(text, "s")
    except ValueError as error:
        raise PicktreeError(f"--limit {text}: {error}") from None
    if seconds <= 0:
        raise PicktreeError(f"--limit {text}: write a time above 0, as in --limit '90 min'")
    return seconds
