"""Plan motions without moving: one that is possible, and one that is explained."""

import picktree as pt
from picktree.robot.planning import NamedGoal
from picktree.world import Pose

with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
    cell.run(pt.Observe(camera="overhead"))
    block = cell.belief.find(colour="red", kind="block")
    plan = cell.plan(pt.PoseGoal(block.grasp(above=0.08)))
    print(plan)
    assert plan
    cell.move(plan)
    cell.move(cell.plan(NamedGoal("home")))

    below = Pose((0.4, 0.0, -0.3), block.grasp()[0].orientation)
    refused = cell.plan(pt.PoseGoal((below,)))
    print(refused)
    assert not refused
