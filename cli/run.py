"""picktree run"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..world.errors import PicktreeError
from .output import keep_stdout, program

if TYPE_CHECKING:
    from .live import View


def run(
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file.")],
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Shipped scene or scene file, for the mission's own.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Parameter of the mission.")
    ] = None,
    faults: Annotated[Path | None, typer.Option(metavar="FILE", help="Faults to inject.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where the run's folder is made.", show_default="runs")
    ] = None,
    backend: Annotated[
        Literal["physics", "kinematic"], typer.Option(help="kinematic: objects follow the gripper.")
    ] = "physics",
    verify: Annotated[
        bool, typer.Option("--verify", help="Judge every trajectory by a second collision checker.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Run a mission in simulation. Exit code 0: the goal is reached; 1: it is missed."""
    answer = keep_stdout() if json else None
    parameters = parse_parameters(set_ or ())

    from ..logs.session import RunRequest, Session

    request = RunRequest(
        mission=mission,
        scene=scene,
        seed=seed,
        parameters=parameters,
        faults=faults,
        out=out,
        backend=backend,
        verify=verify,
    )
    with _view(to_stderr=json) as view:
        result = Session(request, view).run()
    if answer is None:
        print(result.to_text(program()))
    else:
        with answer:
            answer.write(result.to_json_text())
    if result.status == "interrupted":
        raise typer.Exit(130)
    if not result.reached:
        raise typer.Exit(1)


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


def _view(*, to_stderr: bool) -> View:
    from rich.console import Console

    from .live import LinesView, LiveView

    console = Console(stderr=to_stderr, highlight=False)
    return LiveView(console) if console.is_terminal else LinesView(console)
