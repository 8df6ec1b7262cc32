"""Arguments and options that several commands have, and help with options in groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer
from typer.core import TyperCommand


def mission_file(name: str) -> Path:
    """Return the file of a mission that a command takes: a path, or the name of a shipped example."""
    from picktree.files import file_system

    return file_system.example_file(name)


def plan_file(name: str) -> Path:
    """Return the file of a plan that a command takes: a path, or the name of a shipped example."""
    from picktree.files import file_system

    return file_system.example_file(name, what="plan")


def faults_file(name: str) -> Path:
    """Return the file of faults that a command takes: a path, or the name of a shipped example."""
    from picktree.files import file_system

    return file_system.example_file(name, "faults", "faults file")


def run_log(name: str) -> str:
    """Return the log that a command takes: a file, a run's folder, `last`, or DIR@JOB of a batch."""
    if "@" not in name:
        return name
    from picktree.apps.batch import find_run

    return find_run(name)


Log: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="LOG", help="Log file, run folder, 'last', or a batch's job: DIR@seed=7.", parser=run_log
    ),
]
WithoutTruth: TypeAlias = Annotated[
    bool,
    typer.Option("--without-truth", help="Explain by the robot's own sensors and belief alone."),
]
ShippedScene: TypeAlias = Annotated[str, typer.Option(metavar="SCENE", help="Shipped scene or scene file.")]
OtherRobot: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="ROBOT", help="Shipped robot or robot file that replaces the scene's own."),
]
Seed: TypeAlias = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Backend: TypeAlias = Annotated[
    Literal["physics", "kinematic"], typer.Option(help="kinematic: objects follow the gripper.")
]
Verify: TypeAlias = Annotated[
    bool, typer.Option("--verify", help="Check every trajectory with a second collision checker.")
]
OtherSettings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Another value of a parameter of the mission."),
]
RunsFolder: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for the run's folder.", show_default="runs")
]
View: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="VIEW",
        help="corner, front, left, right, top, close, or AZIMUTH,ELEVATION,DISTANCE (degrees, metres).",
    ),
]
Show: TypeAlias = Annotated[
    Literal["belief", "truth", "both"],
    typer.Option(help="Belief of the robot, ground truth, or both: the truth as outlines."),
]
RobotPicture: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="PNG", help="Draw the robot at home, with its frames.")
]
RobotTestPage: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="HTML", help="Write the verdicts of the self-test as a page.")
]
TextFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="File to write instead of stdout."),
]
JunitFile: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write the results as JUnit XML, too.")
]
JsonResult: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
JsonAnswer: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the answer as one JSON object.")]
JsonWritten: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print what was written as one JSON object.")
]
HelpGroups: TypeAlias = Mapping[str, Sequence[str]]
"""Parameters of a command by the heading under which its help has them."""


def grouped_command(groups: HelpGroups) -> type[TyperCommand]:
    """Return the class of a command whose help has its options in these groups; the others come last."""

    class GroupedCommand(TyperCommand):
        # typer has the types of its parser to itself, hence Any.
        def format_options(self, ctx: Any, formatter: Any) -> None:
            headings = {name: heading for heading, names in groups.items() for name in names}
            rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], **{heading: [] for heading in groups}}
            for parameter in self.get_params(ctx):
                row = parameter.get_help_record(ctx)
                argument = parameter.param_type_name == "argument"
                heading = "Arguments" if argument else headings.get(str(parameter.name), "Other options")
                if row is not None:
                    rows.setdefault(heading, []).append(row)
            for heading, records in rows.items():
                if records:
                    with formatter.section(heading):
                        formatter.write_dl(records)

    return GroupedCommand
