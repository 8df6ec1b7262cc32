"""picktree calibrate"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..terminal.output import keep_stdout, program

if TYPE_CHECKING:
    from ..terminal.progress import RunDisplay


def calibrate(
    scene: Annotated[str, typer.Option(metavar="SCENE", help="Shipped scene or scene file.")],
    camera: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Which camera; several times for several.", show_default="all"),
    ] = None,
    tcp: Annotated[bool, typer.Option(help="Find the tool's centre point by touching, too.")] = True,
    target: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the scene's targets.", show_default="the only one")
    ] = None,
    at: Annotated[
        str,
        typer.Option(
            metavar="X,Y[,YAW]",
            help="Where a target is put when the scene has none, as 0.5,0,20deg.",
            show_default="in the middle of where items lie",
        ),
    ] = "",
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Shipped robot or robot file, for the scene's own.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    views: Annotated[
        int, typer.Option(min=4, max=100, help="Places to look from with a camera on the hand.")
    ] = 12,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Scene file to write.",
            show_default="SCENE_calibrated.yaml",
        ),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Write over a file that exists.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where the run's folder is made.", show_default="runs")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the answer as one JSON object.")] = False,
) -> None:
    """Find out where cameras and tool really are, and write a scene that believes it.

    The arm takes the camera on the hand around a target and touches the target with closed fingers; cameras
    that hang still look at it. Items are cleared away for that. Exit code 0: written; 1: it cannot be told.
    """
    answer = keep_stdout() if json else None

    from ...commissioning.calibrate.corrected_scene import parse_place
    from ...commissioning.calibrate.job import CalibrationRequest
    from ...commissioning.calibrate.job import calibrate as calibrated

    place = parse_place(at) if at else None
    asked = CalibrationRequest(
        scene, tuple(camera or ()), tcp, target, place, robot, seed, views, output, replace, out
    )
    with _view() as view:
        found = calibrated(asked, (view,))
    if answer is None:
        print(found.to_text(program()))
    else:
        with answer:
            answer.write(found.to_json_text())
    if found.status == "interrupted":
        raise typer.Exit(130)
    if found.output is None:
        raise typer.Exit(1)


def _view() -> RunDisplay:
    from rich.console import Console

    from ..terminal.progress import LinesDisplay, LiveDisplay

    console = Console(stderr=True, highlight=False)
    return LiveDisplay(console) if console.is_terminal else LinesDisplay(console)
