"""What recording costs: a tick of 60 nodes, 20 objects and the Panda, checkpoints included, and the log that
comes of it; and its share of the ticks of a real run, as that run's own log tells.

python benchmarks/recording.py [--minutes 5] [--rotate-mb 0]
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from picktree.logs import RunLog
from picktree.logs.binary_gltf import link_meshes
from picktree.logs.log_files import Rotation
from picktree.logs.log_records import Control, NodeTime, RunInfo, Timing
from picktree.logs.recording import Recorder
from picktree.session import RunRequest, Session
from picktree.world import (
    BeliefObject,
    BlackboardWrite,
    Box,
    GripperState,
    Intrinsics,
    JointState,
    NodeState,
    ObjectId,
    Pose,
    RgbdImage,
    Tick,
    Transition,
    Wrench,
)
from picktree.world.robot_model import RobotDescription, RobotModel, load_robot
from picktree.world.scene import load_scene

import numpy as np

TICK = 0.05
NODES = 60
MISSION = Path(__file__).resolve().parent.parent / "examples" / "sort_by_colour.yaml"
OBJECTS = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="simulated, of the made-up run")
    parser.add_argument("--rotate-mb", type=float, default=0.0)
    chosen = parser.parse_args()
    made_up(chosen.minutes * 60, Rotation(round(chosen.rotate_mb * 1e6)))
    real()


def made_up(seconds: float, rotation: Rotation) -> None:
    """The cost of each kind of message, in CPU time, which other work on the machine hardly changes."""
    robot, scene = load_robot("panda"), load_scene("three_bins")
    costs = Costs()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        began = time.process_time()
        meshes = link_meshes(robot.urdf)
        models = time.process_time() - began
        info = RunInfo("benchmark", "three_bins", "panda", 1, "none", TICK)
        with Recorder(path, info, rotation=rotation) as recorder:
            recorder.robot_model(meshes)
            recorder.fixed(scene.fixtures, scene.bins)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            run = MadeUpRun(recorder, robot, costs)
            for k in range(round(seconds / TICK)):
                run.record(k)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
        sizes = [part.stat().st_size for part in Path(folder).iterdir()]
        began = time.process_time()
        with RunLog(path) as log:
            ticks = sum(1 for _ in log.ticks())
        reading = time.process_time() - began

    costs.print(ticks)
    print(f"\nmodels of the robot: {models:.2f} s")
    files = f" in {len(sizes)} files" if len(sizes) > 1 else ""
    print(
        f"log of {seconds:.0f} s: {sum(sizes) / 1e6:.1f} MB{files}; its {ticks} ticks are read in "
        f"{reading:.2f} s; memory of the process grew by {memory / 1024:.1f} MB"
    )


class Costs:
    """CPU seconds of each call by kind of message."""

    def __init__(self) -> None:
        self._seconds: dict[str, list[float]] = {}

    def timed(self, name: str, action: Callable[..., None], *values: object) -> None:
        """Call the action with these values, and keep its CPU time."""
        began = time.process_time()
        action(*values)
        self._seconds.setdefault(name, []).append(time.process_time() - began)

    def print(self, ticks: int) -> None:
        """Print a line for each kind, and one for all of them."""
        print(f"{'':12}{'calls':>8}{'mean µs':>10}{'p99 µs':>10}{'µs a tick':>12}")
        total = 0.0
        for name, values in self._seconds.items():
            share = sum(values) / ticks * 1e6
            total += share
            print(
                f"{name:12}{len(values):8}{np.mean(values) * 1e6:10.0f}"
                f"{np.percentile(values, 99) * 1e6:10.0f}{share:12.0f}"
            )
        print(f"{'all':12}{'':8}{'':10}{'':10}{total:12.0f}")


class MadeUpRun:
    """Run of a robot that sways over objects, tick by tick."""

    def __init__(self, recorder: Recorder, robot: RobotDescription, costs: Costs) -> None:
        self._recorder, self._robot, self._timed = recorder, robot, costs.timed
        self._model = RobotModel(robot)
        self._rng = np.random.default_rng(1)
        self._objects = [_object(k, self._rng) for k in range(OBJECTS)]
        self._home = np.array(robot.named["home"])

    def record(self, k: int) -> None:
        """Record everything about tick `k`."""
        recorder, timed, rng, now = self._recorder, self._timed, self._rng, k * TICK
        timed("rotation", recorder.rotate_if_due, now)
        n = len(self._home)
        q = self._home + 0.3 * np.sin(now * 0.7 + np.arange(n)) + rng.normal(0, 2e-5, n)
        links = self._model.link_poses(q, 0.04)
        state = JointState(q, rng.normal(0, 0.1, n), rng.normal(0, 5, n))
        self._objects[0] = replace(self._objects[0], pose=self._model.tcp(q))
        tick, timing = _tick(k), _timing(rng)
        force = rng.normal(0, 0.15, 3).tolist()
        timed("tick", recorder.tick, now, tick)
        names, fingers = self._robot.joints, self._robot.gripper.joints
        timed("joints", recorder.joints, now, names, state, fingers, GripperState(0.04, 0.0, 30.0))
        timed("transforms", recorder.transforms, now, links, self._objects)
        timed("wrench", recorder.wrench, now, Wrench((force[0], force[1], force[2])))
        control = Control("position", tuple(q.tolist()), tuple((q * 1e-4).tolist()))
        timed("control", recorder.control, now, control)
        timed("belief", recorder.belief, now, self._objects)
        if recorder.truth_due(now):
            timed("truth", recorder.truth, now, self._objects)
        timed("timing", recorder.timing, now, timing)
        if k % 92 == 0:
            timed("image", recorder.image, now, _image(now, rng))


def real() -> None:
    """The share of recording in the wall time of a tick, as the run's own log has it."""
    print("\nticks of a run of sort_by_colour in the dense scene, wall time:")
    with tempfile.TemporaryDirectory() as folder:
        for backend in ("physics", "kinematic"):
            request = RunRequest(
                MISSION, scene="dense", seed=1, backend=backend, out=Path(folder), limit=30.0
            )
            with RunLog(Session(request).run().log) as log:
                timings = [at.record for at in log.timings()]
                nodes = len(next(log.ticks()).record.nodes)
            total, recording = (
                np.array([t.total for t in timings]), np.array([t.recording for t in timings])
            )  # fmt: skip
            print(
                f"  {backend:10}{nodes} nodes: {np.mean(total) * 1e3:.2f} ms, of these recording "
                f"{np.mean(recording) * 1e3:.2f} ms ({np.median(recording) * 1e3:.2f} in the median): "
                f"{recording.sum() / total.sum():.1%}"
            )


def _object(k: int, rng: np.random.Generator) -> BeliefObject:
    x, y = rng.uniform(0.3, 0.7), rng.uniform(-0.3, 0.3)
    colour = ("red", "green", "blue")[k % 3]
    return BeliefObject(
        "block",
        "box",
        Box((0.04, 0.04, 0.04)),
        colour,
        Pose((x, y, 0.02)),
        0.001,
        0.01,
        0.9,
        0.0,
        id=ObjectId(f"{colour}_block_{k}"),
    )


def _tick(k: int) -> Tick:
    running = k // 40 % NODES
    nodes = tuple(
        NodeState(
            f"/Main/ForEach/SortOne/Recover/Sequence/Node_{n}",
            "Grasp",
            "RUNNING" if n == running else "SUCCESS" if n < running else "IDLE",
            n == running,
            f"approaching candidate {k // 40}" if n == running else "",
        )
        for n in range(NODES)
    )
    path, item = nodes[running].path, f"red_block_{k // 40}"
    if k % 40:
        return Tick("RUNNING", path, nodes)
    begun = Transition(path, "RUNNING", {"object": item}, item)
    return Tick("RUNNING", path, nodes, (BlackboardWrite("/item", item, nodes[0].path),), (begun,))


def _timing(rng: np.random.Generator) -> Timing:
    a, b, c = rng.uniform(0, 0.004, 3).tolist()
    return Timing(a + b + c, physics=a, control=b, nodes=(NodeTime("/Main", c),))


def _image(now: float, rng: np.random.Generator) -> RgbdImage:
    """Flat colours and noisy depth, as the simulated camera gives them."""
    colour = np.full((240, 320, 3), 190, np.uint8)
    for x, y in rng.integers(20, 200, (12, 2)):
        colour[y : y + 18, x : x + 18] = rng.integers(0, 255, 3)
    depth = rng.normal(0.75, 0.002, (240, 320)).astype(np.float32)
    return RgbdImage("overhead", colour, depth, now, Intrinsics(320, 240, 208.0, 208.0, 160.0, 120.0), Pose())


if __name__ == "__main__":
    main()
