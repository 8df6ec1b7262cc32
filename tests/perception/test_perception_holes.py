"""A board with holes that stands not where it is believed to stand, and pegs in it, through a camera."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.robot.perception import Perception, update_belief
from picktree.robot.perception.view import PerceivedView
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import PlanningScene, Pose, bottom
from picktree.world.hole_geometry import fitting_hole, hole_in_world, tightest_hole
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import load_scene
from picktree.world.scene.destinations import destination_rule, is_at

SCENE = load_scene("pegs")
ROBOT = load_robot(SCENE.robot)


def filled(seed: int) -> KinematicHardware:
    """All pegs in the holes in which they belong."""
    hardware = KinematicHardware(SCENE, ROBOT, seed)
    (board,) = (f for f in hardware.true_fixtures() if f.holes)
    for body in hardware.bodies.items:
        hole = tightest_hole(board.holes, body.entry.shape)
        assert hole is not None
        inside = Pose((0.0, 0.0, -bottom(body.entry.shape, Pose()) - hole.depth))
        hardware.bodies.put(replace(body, pose=board.pose @ hole.pose @ inside))
    hardware.bodies.settle()
    return hardware


def seen(hardware: KinematicHardware, belief: PlanningScene) -> PerceivedView:
    image = hardware.cameras["overhead"].capture()
    perception = Perception(SCENE, RobotModel(ROBOT))
    return perception.detect(image, hardware.arm.read().position, hardware.gripper.width, belief.held)


def empty_belief() -> PlanningScene:
    return PlanningScene(SCENE.fixtures, SCENE.bins, destination_rule(SCENE.destinations))


@pytest.mark.parametrize("seed", [1, 3])
def test_pegs_are_seen_in_their_holes_and_nothing_else_is(seed: int) -> None:
    hardware, belief = filled(seed), empty_belief()
    summary = update_belief(belief, seen(hardware, belief), 0.0)
    assert summary.unexplained == 0
    true = {f"{body.colour} {body.kind}": body for body in hardware.truth()}
    assert {f"{o.colour} {o.kind}" for o in belief.objects} == set(true)
    for believed in belief.objects:
        body = true[f"{believed.colour} {believed.kind}"]
        assert body.seat is not None
        assert believed.place == body.seat.hole
        assert believed.pose.distance(body.pose) < 0.008
        assert is_at(believed.place, belief.destination(believed.id) or "")
        # Its own hole is free for it, and for nobody else.
        hole = fitting_hole(belief, believed.id)
        assert hole is not None
        assert hole.id == believed.place
        assert hole_in_world(belief, hole.id).distance(believed.pose) < 0.03


def test_an_empty_board_that_stands_elsewhere_is_no_obstacle() -> None:
    hardware, belief = KinematicHardware(SCENE, ROBOT, 4), empty_belief()
    view = seen(hardware, belief)
    assert view.unexplained == ()
    assert [d.place for d in view.detections] == ["table"] * 6


def test_of_two_pegs_the_first_takes_the_closer_hole() -> None:
    belief = empty_belief()
    hardware = filled(1)
    update_belief(belief, seen(hardware, belief), 0.0)
    thin, thick = (next(o for o in belief.objects if o.kind == kind) for kind in ("dowel_30", "dowel_40"))
    assert fitting_hole(belief, thin.id, "board") == SCENE.fixture("board").holes[0]
    belief.put(replace(thick, place="table"), "test")
    belief.put(replace(thin, place="table"), "test")
    belief.put(replace(thick, id=belief.new_id("other"), place="board/round_31"), "test")
    other = fitting_hole(belief, thin.id)
    assert other is not None
    assert other.id == "board/round_42"
    assert fitting_hole(belief, thin.id, "board/round_31") is None
    assert fitting_hole(belief, thin.id, "table") is None
