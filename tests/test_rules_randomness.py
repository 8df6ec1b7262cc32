"""Fourth rule: randomness is keyed. One seed, one run, bit for bit; more use here shifts nothing there."""

from __future__ import annotations

import ast
import io
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.apps.cli.debug_prompt import DebugPrompt
from picktree.logs import RunResult
from picktree.session import Debugger, DebuggerStop, Execution, Observer, RunRequest, Session
from picktree.simulation import Backend
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Tick
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

from .rooms import ROOT, modules
from .skills.cell import EXAMPLES, Cell, items, mission, sorting

BACKENDS: tuple[Backend, ...] = ("kinematic", "physics")
ELSEWHERE = """\
import sys
from pathlib import Path
from picktree.session import Execution
from picktree.session import Observer
from picktree.session import RunRequest; from picktree.session import Session
for backend in ("kinematic", "physics"):
    request = RunRequest(Path(sys.argv[1]), seed=3, out=Path(sys.argv[2]), backend=backend)
    print(Session(request).run().digest)
"""


class Onlooker(Observer):
    """Looks at everything that a live view could show."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def started(self, run: Execution, folder: Path) -> None:
        self.seen.append(f"{len(run.tree.structure())} nodes in {folder}")

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        self.seen.append(f"{now} {[str(node) for node in report.nodes]} {items_done}/{items_total}")

    def finished(self, result: RunResult) -> None:
        self.seen.append(result.to_text())


class Inquirer:
    """Stops at every start and end of a node, and looks at all that the debugger can show."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def __call__(self, debugger: Debugger, stop: DebuggerStop) -> None:
        commands = iter(("tree", "where", "node", "blackboard", "belief", "print items_left", "next"))
        out = io.StringIO()
        DebugPrompt(lambda _: next(commands), out)(debugger, stop)
        self.seen.append(out.getvalue())


def digest(
    folder: Path,
    backend: Backend,
    seed: int = 3,
    *,
    verify: bool = False,
    watcher: Onlooker | None = None,
    inquirer: Inquirer | None = None,
) -> str:
    request = RunRequest(EXAMPLES / "one_pick.yaml", seed=seed, out=folder, backend=backend, verify=verify)
    debugger = Debugger(inquirer) if inquirer else None
    observers = [each for each in (watcher, debugger) if each is not None]
    return Session(request, observers=observers).run().digest


@pytest.fixture(scope="module")
def digests(tmp_path_factory: pytest.TempPathFactory) -> dict[Backend, str]:
    """Digest of the run with seed 3 on each backend."""
    folder = tmp_path_factory.mktemp("plain")
    return {backend: digest(folder, backend) for backend in BACKENDS}


def test_one_seed_one_digest_in_another_process_with_another_hash_seed(
    digests: dict[Backend, str], tmp_path: Path
) -> None:
    hash_seed = "0" if os.environ.get("PYTHONHASHSEED") == "4711" else "4711"
    there = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, str(EXAMPLES / "one_pick.yaml"), str(tmp_path)],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
    )
    assert there.returncode == 0, there.stderr
    assert there.stdout.split() == [digests[backend] for backend in BACKENDS]
    assert digests["kinematic"] != digests["physics"]


PLANNED_BEFORE = """\
import sys
from picktree.session import arithmetic
if sys.argv[1] == "plan":
    from picktree.robot.planning import PoseGoal, Request
    from tests.planning.motion_cell import Cell, Pose, np, shelf_scene
    left = Pose.from_rpy((0.6, 0.17, 0.4), (0.0, np.pi / 2, 0.0))
    Cell(shelf_scene(), verify=False).plan.solver.solve(Request(PoseGoal((left,))), 1)
print(arithmetic().probe["coal"])
"""


def test_what_is_planned_before_a_run_leaves_its_distances_alone() -> None:
    """The first computation of coal in a process decides the last bits of the later ones."""
    told = {
        subprocess.run(
            [sys.executable, "-c", PLANNED_BEFORE, what],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for what in ("plan", "nothing")
    }
    assert len(told) == 1


@pytest.mark.parametrize("backend", BACKENDS)
def test_neither_a_second_judge_nor_an_onlooker_nor_a_debugger_changes_the_digest(
    backend: Backend, digests: dict[Backend, str], tmp_path: Path
) -> None:
    watcher, inquirer = Onlooker(), Inquirer()
    told = digest(tmp_path, backend, verify=True, watcher=watcher, inquirer=inquirer)
    assert told == digests[backend]
    assert len(watcher.seen) > 50
    assert len(inquirer.seen) > 10
    assert not [text for text in inquirer.seen if "failed:" in text]


@pytest.mark.parametrize("backend", BACKENDS)
def test_another_seed_another_digest(backend: Backend, digests: dict[Backend, str], tmp_path: Path) -> None:
    assert digest(tmp_path, backend, 4) != digests[backend]


def test_two_runs_of_one_process_do_not_shift_each_other() -> None:
    """Two cells ticked in turn end as one that runs alone does."""

    def trace(cell: Cell) -> list[tuple[float, ...]]:
        return [body.pose.position for body in cell.hardware.truth()]

    alone, one, two = (Cell(sorting(), items(block=1), "physics") for _ in range(3))
    other = Cell(sorting(), items(ball=1), "physics", seed=8)
    alone.finish()
    while one.running or not one.world.clock.now:
        one.tick()
        if other.running or not other.world.clock.now:
            other.tick()
    two.finish()
    assert trace(one) == trace(alone) == trace(two)
    assert one.world.clock.now == alone.world.clock.now == two.world.clock.now


def test_what_is_spawned_depends_on_scene_and_seed_alone() -> None:
    scene, robot = load_scene("three_bins"), load_robot("panda")
    physics, kinematic = PhysicsHardware(scene, robot, 5), KinematicHardware(scene, robot, 5)
    pairs = list(zip(physics.initial_truth, kinematic.initial_truth, strict=True))
    assert [(a.id, a.kind, a.colour) for a, _ in pairs] == [(b.id, b.kind, b.colour) for _, b in pairs]
    assert max(np.linalg.norm(np.subtract(a.pose.position, b.pose.position)) for a, b in pairs) < 0.002

    sensors = replace(scene, cameras=(), thinking=replace(scene.thinking, image=1.0))
    assert KinematicHardware(sensors, robot, 5).initial_truth == kinematic.initial_truth
    assert KinematicHardware(scene, robot, 6).initial_truth != kinematic.initial_truth


def two_cameras() -> PhysicsHardware:
    scene = load_scene("sort_small")
    (camera,) = scene.cameras
    return PhysicsHardware(
        replace(scene, cameras=(camera, replace(camera, name="second"))), load_robot("panda"), 3
    )


def test_the_noise_of_one_camera_does_not_shift_when_others_are_used_more() -> None:
    quiet, busy = two_cameras(), two_cameras()
    for _ in range(3):
        busy.cameras["second"].capture()
        for device in (busy.arm, busy.gripper, busy.wrench):
            device.read()
    first, again = (hardware.cameras["overhead"].capture() for hardware in (quiet, busy))
    assert np.array_equal(first.depth, again.depth)
    assert np.array_equal(first.colour, again.colour)
    assert not np.array_equal(first.depth, busy.cameras["overhead"].capture().depth)
    assert not np.array_equal(first.depth, quiet.cameras["second"].capture().depth)

    assert np.array_equal(quiet.arm.read().position, busy.arm.read().position)
    assert quiet.wrench.read() == busy.wrench.read()


def test_a_picture_more_shifts_neither_the_other_sensors_nor_the_planner() -> None:
    """A robot that looks twice meets the same joints' and wrist's noise, and plans the same ways."""
    look = "{Observe: {camera: overhead}}"
    ways: list[list[float]] = []
    readings: list[object] = []
    for body in (f"[{look}, {{GoTo: {{pose: rest}}}}]", f"[{look}, {look}, {{GoTo: {{pose: rest}}}}]"):
        cell = Cell(mission(f"Sequence: {body}"), items(block=1), "physics")
        cell.finish()
        ways.append(cell.world.control.held_position.tolist())
        while cell.world.clock.now < 4.0:
            cell.wait()
        reading = cell.hardware.wrench.read()
        readings.append(np.subtract(reading.force, cell.hardware._body.read().wrench[:3]).tolist())
    assert ways[0] == ways[1]
    assert readings[0] == pytest.approx(readings[1], abs=1e-9)


def test_every_generator_is_keyed() -> None:
    """`default_rng` is called with a key in one module; nobody uses Python's or numpy's global generators."""
    calls: dict[str, list[str]] = {}
    for path in modules(but=("apps/batch", "apps/cli", "apps/studio")):
        where, text = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
        if not re.search(r"random|secrets|uuid", text):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [alias.name for alias in node.names]
                imported = names if isinstance(node, ast.Import) else [node.module or ""]
                if {"random", "secrets", "uuid"} & set(imported):
                    calls.setdefault(where, []).append("import random")
            if isinstance(node, ast.Call) and "random." in ast.unparse(node.func):
                calls.setdefault(where, []).append(ast.unparse(node))
    assert calls == {
        # Where inverse kinematics begins is always the same.
        "robot/planning/inverse_kinematics.py": [
            "np.random.default_rng(0).uniform(size=(SEED_COUNT, model.n))",
            "np.random.default_rng(0)",
        ],
        "robot/planning/constrained_rrt.py": ["np.random.default_rng(seed)"],
        "robot/planning/goal_configurations.py": ["np.random.default_rng(seed)"],
        "robot/planning/planning_failures.py": ["np.random.default_rng(0)"],
        "robot/planning/joint_planner.py": [
            "np.random.default_rng([seed, len(STEP_SHARES)])",
            "np.random.default_rng([seed, attempt])",
        ],
        "robot/planning/return_path.py": ["np.random.default_rng(seed)"],
        # Samples of a robot file that is made; no run depends on them.
        "apps/commissioning/arm_poses.py": [
            "np.random.default_rng([seed, 1])",
            "np.random.default_rng([seed, 2])",
        ],
        "apps/commissioning/base_pose.py": ["np.random.default_rng(0)"],
        "apps/commissioning/joints.py": ["np.random.default_rng([seed, 3])"] * 2,
        "apps/commissioning/free_space.py": ["np.random.default_rng([seed, 4])"],
        "apps/commissioning/model_checks.py": ["np.random.default_rng(0)"],
        "apps/commissioning/robot_test.py": ["np.random.default_rng(0)"],
        "apps/commissioning/self_collision.py": ["np.random.default_rng([seed, 0])"],
        "world/random_streams.py": [
            "np.random.default_rng([self.seed, zlib.crc32(stream.encode()), n, *variant])"
        ],
        # Intervals of figures over runs.
        "logs/operator_figures.py": [
            "np.random.default_rng(0).integers(pairs.shape[1], size=(_RESAMPLES, pairs.shape[1]))",
            "np.random.default_rng(0)",
        ],
    }
