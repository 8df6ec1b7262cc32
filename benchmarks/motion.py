"""What planning costs: `python benchmarks/motion.py`. CPU milliseconds; nothing else should be running."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from picktree.world.causes import Failure
from picktree.world.journal import Journal
from picktree.world.motion.collision import Collision
from picktree.world.motion.fcl_queries import SceneQueries
from picktree.world.motion.ik import InverseKinematics
from picktree.world.motion.judge import Judge
from picktree.world.motion.requests import PoseGoal
from picktree.world.motion.service import PlanService
from picktree.world.robot.load import load_robot
from picktree.world.robot.model import RobotModel
from picktree.world.scene.description import Fixture
from picktree.world.scene.planning_scene import BeliefObject, PlanningScene
from picktree.world.shapes import Box
from picktree.world.streams import Streams
from picktree.world.thinking import ThinkingAccount
from picktree.world.values import ObjectId, Pose

MODEL = RobotModel(load_robot("panda"))
HOME = MODEL.named("home")


def table() -> PlanningScene:
    """Twenty boxes on a table."""
    rng = np.random.default_rng(0)
    scene = PlanningScene([Fixture(ObjectId("table"), Box((1.0, 1.4, 0.04)), Pose((0.5, 0.0, -0.02)))], [])
    for k in range(20):
        x, y = rng.uniform([0.35, -0.3], [0.65, 0.3])
        box, pose = Box((0.04, 0.04, 0.05)), Pose((float(x), float(y), 0.025))
        scene.put(
            BeliefObject(ObjectId(f"box_{k}"), "item", "box", "box", box, "red", pose, 0, 0, 1, 0), "set up"
        )
    return scene


def milliseconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return (time.process_time() - begun) * 1e3


def say(what: str, times: list[float]) -> None:
    print(f"{what:34} median {np.median(times):7.3f} ms   p95 {np.percentile(times, 95):7.3f} ms")


def main() -> None:
    rng = np.random.default_rng(1)
    scene = table()
    collision = Collision(MODEL)
    collision.update(scene, 0.08)
    configurations = rng.uniform(MODEL.lower, MODEL.upper, (5000, MODEL.n))
    spent = milliseconds(lambda: [collision.free(q) for q in configurations])
    print(f"{'collision check':34} {spent / 5:7.1f} µs")

    ik = InverseKinematics(MODEL)
    poses = [MODEL.tcp(q) for q in rng.uniform(MODEL.planned_lower, MODEL.planned_upper, (500, MODEL.n))]
    solved: list[bool] = []
    times = [
        milliseconds(lambda p=pose: solved.append(bool(ik.solutions(p, np.random.default_rng(0), HOME, 1))))
        for pose in poses
    ]
    say(f"IK, {sum(solved)} of {len(solved)} reachable solved", times)

    times = []
    for k in range(50):
        box = scene.get("box_0")
        scene.put(replace(box, shape=Box((0.04, 0.04, 0.03 + k * 1e-4))), "resized")
        times.append(milliseconds(lambda: collision.update(scene, 0.08)))
    say("scene rebuilt", times)

    at, judge = HOME, Judge(MODEL)
    service = PlanService(
        MODEL,
        scene,
        SceneQueries(MODEL, scene),
        Streams(1),
        Journal(),
        ThinkingAccount(0.05),
        25e-6,
        configuration=lambda: at,
        width=lambda: 0.08,
    )
    times, judging = list[float](), list[float]()
    planners: dict[str, int] = {}
    for _ in range(100):
        x, y, z, yaw = (float(c) for c in rng.uniform([0.35, -0.3, 0.1, -1.5], [0.65, 0.3, 0.3, 1.5]))
        begun = time.process_time()
        steps = service.to(PoseGoal((Pose.from_rpy((x, y, z), (np.pi, 0.0, yaw)),)))
        try:
            while True:
                next(steps)
        except StopIteration as end:
            plan = end.value
        except Failure as failure:
            planners[failure.cause.name] = planners.get(failure.cause.name, 0) + 1
            continue
        times.append((time.process_time() - begun) * 1e3)
        planners[plan.planner] = planners.get(plan.planner, 0) + 1
        at = plan.trajectory.end
        judging.append(milliseconds(lambda p=plan: judge.judge(p.trajectory, scene, 0.08)))
    say(f"plan {planners}", times)
    say("judge (python-fcl)", judging)


if __name__ == "__main__":
    main()
