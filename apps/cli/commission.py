"""Commands that set up a cell: calibrate, plan, robot new, robot test, robot show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import (
    JsonAnswer,
    JsonResult,
    OtherRobot,
    RobotPicture,
    RobotTestPage,
    RunsFolder,
    Seed,
    ShippedScene,
    TextFile,
)
from .output import end_with, keep_stdout, print_answer, program
from .run import Speed, parse_share

if TYPE_CHECKING:
    from picktree.apps.commissioning import RobotTestResult


def calibrate(
    scene: ShippedScene,
    camera: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Camera to calibrate; may be repeated.", show_default="all"),
    ] = None,
    tcp: Annotated[bool, typer.Option(help="Find the tool's centre point by touching, too.")] = True,
    target: Annotated[
        str | None, typer.Option(metavar="NAME", help="Target of the scene.", show_default="the only one")
    ] = None,
    at: Annotated[
        str,
        typer.Option(
            metavar="X,Y[,YAW]",
            help="Pose of the target that is added to a scene without a target, as 0.5,0,20deg.",
            show_default="the middle of the items' area",
        ),
    ] = "",
    robot: OtherRobot = None,
    seed: Seed = 0,
    views: Annotated[
        int, typer.Option(min=4, max=100, help="Number of viewpoints of a camera on the hand.")
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
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite an existing file.")] = False,
    robot_at: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Calibrate the robot whose process listens there. The target is at its place in the scene.",
            show_default="a simulation",
        ),
    ] = "",
    speed: Speed = "100%",
    out: RunsFolder = None,
    json: JsonAnswer = False,
) -> None:
    """Calibrate the poses of cameras and tool, and write a scene with them.

    The arm takes the camera on the hand around a target and touches the target with closed fingers; fixed
    cameras look at it. The items are removed for that; from a robot's table a person removes them. Exit
    code 0: written; 1: too few observations.
    """
    answer = keep_stdout() if json else None

    from picktree.apps.commissioning import CalibrationRequest, parse_place
    from picktree.apps.commissioning import calibrate as calibrated

    from .progress import run_display

    place = parse_place(at) if at else None
    request = CalibrationRequest(
        scene,
        tuple(camera or ()),
        tcp,
        target,
        place,
        robot,
        seed,
        views,
        output,
        replace,
        out,
        robot_at,
        parse_share(speed),
    )
    with run_display() as view:
        found = calibrated(request, (view,))
    print_answer(answer, lambda: found.to_text(program()), found.to_json_text)
    end_with(found.output is not None, found.status)


def cell(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="Shipped scene or scene file.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the items' places, as of `run`.")] = 0,
    robot: OtherRobot = None,
    output: TextFile = None,
) -> None:
    """Write a scene with its items and its robot as a cell file, one JSON object.

    `python -m picktree_cell` serves it as a robot in MuJoCo, for `run --robot-at`; any other program may read
    it. Exit code 0: written.
    """
    import json

    from picktree.simulation import cell_file
    from picktree.world.robot_model import load_robot
    from picktree.world.scene import load_scene

    from .output import require_place, show

    require_place(output)
    description = load_scene(scene, Path.cwd())
    beside = Path.cwd() if robot else Path(description.source).parent
    arm = load_robot(robot or description.robot, beside)
    show(json.dumps(cell_file(description, arm, seed), allow_nan=False) + "\n", output)


def plan(
    scene: ShippedScene,
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
    robot: OtherRobot = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the spawned items and of the planner.")] = 0,
    upright: Annotated[
        str, typer.Option(metavar="TILT", help="Maximum tilt of a tool that points down, for example 10deg.")
    ] = "",
    line: Annotated[bool, typer.Option("--line", help="Move the tool straight to the goal.")] = False,
    clearance: Annotated[
        str, typer.Option(metavar="LENGTH", help="Addition to the usual collision margins, as 20mm.")
    ] = "",
    budget: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Maximum number of collision checks.", show_default="20000"),
    ] = None,
    planner: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Planner, as rrt_connect, bit_star, aorrtc; a wrong name lists all."
        ),
    ] = "",
    verify: Annotated[
        bool, typer.Option("--verify", help="Check the trajectory with a second collision checker.")
    ] = False,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the plan or the failure.")] = None,
    view: Annotated[
        str, typer.Option(metavar="VIEW", help="View of the picture, as in picktree snapshot.")
    ] = "corner",
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the picture, in pixels.")] = "1280x800",
    json: JsonAnswer = False,
) -> None:
    """Plan a motion in a scene, without a mission. Exit code 0: there is a plan; 1: no plan.

    The robot believes exactly what the scene spawns by that seed. Objects are named as perception names them:
    colour, kind and a number, as red_block_1; a goal that does not exist lists all.
    """
    answer = keep_stdout() if json else None

    from picktree.analysis.render import parse_size, parse_view
    from picktree.apps.commissioning import PlanQuery, plan_in_scene, quantity
    from picktree.robot.planning import DEFAULT_CHECK_BUDGET

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
            planner,
            verify,
            picture,
            parse_view(view),
            parse_size(size),
        )
    )
    print_answer(answer, found.to_text, found.to_json_text)
    end_with(found.good)


robot = typer.Typer(help="Make robot files from URDFs, test them, and look at them.", no_args_is_help=True)


@robot.command()
def new(
    urdf: Annotated[str, typer.Argument(metavar="URDF", help="File, or package:path in a Python package.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Robot file to write.")],
    gripper: Annotated[
        str | None,
        typer.Option(
            metavar="URDF[:LINK]", help="Gripper to mount: its URDF, and the first link of the gripper in it."
        ),
    ] = None,
    mount: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link of the arm on which --gripper is mounted.")
    ] = None,
    base: Annotated[
        str | None, typer.Option(metavar="LINK", help="First link of the arm; links before it do not move.")
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="Last link of the arm, if there are several.")
    ] = None,
    picture: RobotPicture = None,
    samples: Annotated[
        int, typer.Option(min=100, max=1_000_000, help="Samples of self-collisions.")
    ] = 10_000,
    seed: Seed = 0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    test: Annotated[bool, typer.Option(help="Test the robot in physics, by picktree robot test.")] = True,
    page: RobotTestPage = None,
    json: JsonResult = False,
) -> None:
    """Propose a robot file for a URDF: joints and limits, gripper and TCP, poses, self-collisions.

    It ends with a self-test in physics. The file is written with any result of the test.
    """
    answer = keep_stdout() if json else None
    from picktree.analysis.render import draw_robot
    from picktree.apps.commissioning import ProposalRequest, propose, summary_of_new
    from picktree.files import PicktreeError, file_system

    if output.is_dir():
        raise PicktreeError(f"{output} is a folder; name the robot file in it, as {output / 'arm.yaml'}")
    if output.exists() and not force:
        raise PicktreeError(f"{output} is there already; --force writes over it")
    for file in (output, *(f for f in (picture, page) if f is not None)):
        if not file.parent.is_dir():
            raise PicktreeError(f"there is no folder {file.parent} for {file.name}; make it first")
    if mount is not None and gripper is None:
        raise PicktreeError("--mount says where --gripper goes; give --gripper URDF[:LINK], too")
    proposal = propose(ProposalRequest(urdf, output, gripper, mount, base, tip, samples, seed))
    with file_system.whole([output] if picture is None else [output, picture], output) as beside:
        beside[0].write_text(proposal.text, encoding="utf-8")
        if picture is not None:
            drawn = beside[1].with_name(f"{beside[1].name}.png")
            draw_robot(proposal.robot, drawn)
            drawn.replace(beside[1])
    tried = _tested(str(output), page) if test or page is not None else None
    result = summary_of_new(proposal, str(picture) if picture is not None else "", tried)
    hint = f"try it      {program()} run examples/one_pick.yaml --robot {output}"
    print_answer(answer, lambda: f"{result.to_text()}\n{hint}", result.to_json_text)


@robot.command()
def test(
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="Shipped robot or robot file.")],
    robot_at: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Test the robot whose process listens there. The arm moves by millimetres.",
            show_default="a simulation",
        ),
    ] = "",
    scene: Annotated[
        str, typer.Option(metavar="SCENE", help="Scene of the cell, with --robot-at.")
    ] = "sort_small",
    page: RobotTestPage = None,
    json: JsonResult = False,
) -> None:
    """Test a robot in physics: its model, motions, gripper, and three grasps.

    The tests: masses, limits, home, fingers, tool frame; effort at rest, tracking, braking, a soft retreat,
    the gripper, the camera's view. Then a block, a can and a flat plate are grasped. A failed test names the
    change and the file. Exit code 0: all tests are passed; 1: one failed.

    With --robot-at: weight of the hand, noise, axes and sign of the wrist, 5 mm along each axis, latencies,
    gripper. The values go into ROBOT.measured.json, which `run --robot-at` reads.
    """
    answer = keep_stdout() if json else None
    result = _tested(name, page, scene, robot_at)
    print_answer(answer, result.to_text, result.to_json_text)
    end_with(result.good)


def _tested(name: str, page: Path | None, scene: str = "sort_small", robot_at: str = "") -> RobotTestResult:
    """Test a robot, and write the page if requested."""
    from picktree.apps.commissioning import test_external_robot, test_robot
    from picktree.world.robot_model import load_robot

    result = test_external_robot(name, scene, robot_at) if robot_at else test_robot(name)
    if page is not None:
        result.write_page(load_robot(name, Path.cwd()), page)
    return result


@robot.command()
def show(
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="Shipped robot or robot file.")],
    picture: RobotPicture = None,
    json: JsonResult = False,
) -> None:
    """Show a robot file: joints, gripper, poses, pairs of links without a collision check."""
    answer = keep_stdout() if json else None
    from dataclasses import replace

    from picktree.analysis.render import draw_robot
    from picktree.apps.commissioning import summary_of
    from picktree.files import file_system
    from picktree.world.robot_model import load_robot

    loaded = load_robot(name, Path.cwd())
    result = summary_of(loaded)
    if picture is not None:
        with file_system.whole([picture], picture) as (beside,):
            drawn = beside.with_name(f"{beside.name}.png")
            draw_robot(loaded, drawn)
            drawn.replace(beside)
        result = replace(result, picture=str(picture))
    print_answer(answer, result.to_text, result.to_json_text)
