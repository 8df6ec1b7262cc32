"""picktree plan"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..terminal.output import keep_stdout


def plan(
    scene: Annotated[str, typer.Option(metavar="SCENE", help="Shipped scene or scene file.")],
    to: Annotated[
        str,
        typer.Option(
            metavar="GOAL",
            help="A pose of the robot, as home; an object (over its best grasp and down onto it); a bin; or "
            "x,y,z[,roll,pitch,yaw] of the tool, as 500mm,0,200mm,180deg,0,0 (without units: m, rad).",
        ),
    ],
    begin: Annotated[
        str,
        typer.Option(
            "--from", metavar="START", help="A pose of the robot, or a number for each joint: 0,-45deg,…"
        ),
    ] = "home",
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Shipped robot or robot file, for the scene's own.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what is spawned, and of the planner.")] = 0,
    upright: Annotated[
        str, typer.Option(metavar="TILT", help="Keep the tool looking down within this, as 10deg.")
    ] = "",
    line: Annotated[bool, typer.Option("--line", help="The tool straight to the goal.")] = False,
    clearance: Annotated[
        str, typer.Option(metavar="LENGTH", help="To keep beyond the usual margins, as 20mm.")
    ] = "",
    budget: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Collision checks.", show_default="20000")
    ] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Judge the trajectory by a second collision checker.")
    ] = False,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the plan or the failure.")] = None,
    view: Annotated[
        str, typer.Option(metavar="VIEW", help="Of the picture; as in picktree snapshot.")
    ] = "corner",
    size: Annotated[str, typer.Option(metavar="WxH", help="Of the picture, in pixels.")] = "1280x800",
    json: Annotated[bool, typer.Option("--json", help="Print the answer as one JSON object.")] = False,
) -> None:
    """Plan a motion in a scene, without a mission. Exit code 0: there is a plan; 1: there is none.

    The robot believes exactly what the scene spawns by that seed. Objects are named as perception names them:
    colour, kind and a number, as red_block_1; a goal that does not exist lists all.
    """
    answer = keep_stdout() if json else None

    from ...analysis.render.viewpoint import parse_size, parse_view
    from ...commissioning.plan_trial import PlanQuery, plan_in_scene
    from ...commissioning.target_syntax import quantity
    from ...planning.requests import DEFAULT_CHECK_BUDGET

    found = plan_in_scene(
        PlanQuery(
            scene,
            to,
            begin,
            robot,
            seed,
            quantity("--upright", upright, "rad") if upright else None,
            line,
            quantity("--clearance", clearance, "m") if clearance else 0.0,
            DEFAULT_CHECK_BUDGET if budget is None else budget,
            verify,
            picture,
            parse_view(view),
            parse_size(size),
        )
    )
    if answer is None:
        print(found.to_text())
    else:
        with answer:
            answer.write(found.to_json_text())
    if not found.good:
        raise typer.Exit(1)
