"""picktree robot"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..terminal.output import keep_stdout, program

robot = typer.Typer(help="Make robot files from URDFs, and look at them.", no_args_is_help=True)


@robot.command()
def new(
    urdf: Annotated[str, typer.Argument(metavar="URDF", help="File, or package:path in a Python package.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Robot file to write.")],
    gripper: Annotated[
        str | None,
        typer.Option(metavar="URDF[:LINK]", help="Gripper to mount, from that link of its URDF on."),
    ] = None,
    mount: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link of the arm on which --gripper is mounted.")
    ] = None,
    base: Annotated[
        str | None, typer.Option(metavar="LINK", help="Where the arm begins; what is before it stands still.")
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="Where the arm ends, of several that there are.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the robot at home, with its frames.")
    ] = None,
    samples: Annotated[int, typer.Option(min=100, max=1_000_000, help="For the self-collisions.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Propose a robot file for a URDF: joints and limits, gripper and TCP, poses, self-collisions."""
    answer = keep_stdout() if json else None
    from ...analysis.render.snapshot import draw_robot
    from ...commissioning.robot_setup.proposal import ProposalRequest, propose
    from ...commissioning.robot_setup.summary import summary_of_new
    from ...errors import PicktreeError
    from ...files.atomic_write import whole

    if output.exists() and not force:
        raise PicktreeError(f"{output} is there already; --force writes over it")
    if mount is not None and gripper is None:
        raise PicktreeError("--mount says where --gripper goes; give --gripper URDF[:LINK], too")
    proposal = propose(ProposalRequest(urdf, output, gripper, mount, base, tip, samples, seed))
    with whole([output] if picture is None else [output, picture], output) as beside:
        beside[0].write_text(proposal.text, encoding="utf-8")
        if picture is not None:
            drawn = beside[1].with_name(f"{beside[1].name}.png")
            draw_robot(proposal.robot, drawn)
            drawn.replace(beside[1])
    result = summary_of_new(proposal, str(picture) if picture is not None else "")
    if answer is not None:
        with answer:
            answer.write(result.to_json_text())
        return
    print(result.to_text())
    print(f"try it      {program()} run examples/one_pick.yaml --robot {output}")


@robot.command()
def show(
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="Shipped robot or robot file.")],
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the robot at home, with its frames.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Tell what a robot file says: joints, gripper, poses, pairs of links that are not checked."""
    answer = keep_stdout() if json else None
    from dataclasses import replace

    from ...analysis.render.snapshot import draw_robot
    from ...commissioning.robot_setup.summary import summary_of
    from ...files.atomic_write import whole
    from ...robots.loading import load_robot

    loaded = load_robot(name, Path.cwd())
    result = summary_of(loaded)
    if picture is not None:
        with whole([picture], picture) as (beside,):
            drawn = beside.with_name(f"{beside.name}.png")
            draw_robot(loaded, drawn)
            drawn.replace(beside)
        result = replace(result, picture=str(picture))
    if answer is None:
        print(result.to_text())
    else:
        with answer:
            answer.write(result.to_json_text())
