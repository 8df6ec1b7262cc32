"""Planners chosen by name: OMPL's and those of plug-ins keep margins, constraints, budget and seed."""

from __future__ import annotations

import gc
import importlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from hashlib import sha256
from math import radians
from pathlib import Path

import numpy as np
import pytest

from picktree.apps.cli.file_schemas import CHECKS
from picktree.apps.commissioning import PlanQuery, plan_in_scene
from picktree.files import PicktreeError
from picktree.files.file_checks import check_files
from picktree.logs import RunLog
from picktree.robot.planning import (
    JointGoal,
    MotionPlan,
    OffsetGoal,
    PlannerOverrides,
    PoseGoal,
    Request,
    RequestSolver,
    UprightConstraint,
    ompl_planners,
)
from picktree.robot.planning.path_constraints import PathConstraints
from picktree.session import RunRequest, Session
from picktree.world import Array, Box, Failure, ObjectId, Plan, PlanningScene, Pose, planning
from picktree.world.planner_names import AUTO, BUILT_IN
from picktree.world.robot_model import load_robot
from picktree.world.scene import Fixture

from ..other_process import OtherProcess
from .motion_cell import MODEL, Cell, down, run

OMPL = tuple(name for name in BUILT_IN if name != AUTO)
LEFT, RIGHT = down(0.5, 0.35, 0.2), down(0.5, -0.35, 0.2)


def walled(high: float = 0.3) -> PlanningScene:
    """A wall across the table, between left and right."""
    table = Fixture(ObjectId("table"), Box((1.0, 1.4, 0.04)), Pose((0.5, 0.0, -0.02)))
    return PlanningScene(
        [table, Fixture(ObjectId("wall"), Box((0.5, 0.02, high)), Pose((0.6, 0.0, high / 2)))], []
    )


def start() -> Array:
    """Left of the wall."""
    plan, _ = run(Cell(walled(), verify=False).plan.to(PoseGoal((LEFT,))))
    return plan.trajectory.end


START = start()


def solver(scene: PlanningScene | None = None, planner: str = AUTO) -> RequestSolver:
    return RequestSolver(
        MODEL, scene or walled(), configuration=lambda: START, width=lambda: 0.08, planner=planner
    )


BUDGETS = {"rrt_star": 30_000, "informed_rrt_star": 30_000}
"""Collision checks with which planners find round the wall that need more than others."""


def request(planner: str, budget: int | None = None) -> Request:
    return Request(PoseGoal((RIGHT,)), START, planner=planner, budget=budget or BUDGETS.get(planner, 8000))


@cache
def found(name: str, seed: int) -> MotionPlan:
    return solver().solve(request(name), seed)


@pytest.mark.parametrize("name", OMPL)
def test_each_planner_goes_round_a_wall_and_names_itself(name: str) -> None:
    cell = Cell(walled())
    plan, _ = run(cell.plan.solve(request(name)))
    assert plan.planner == name
    assert cell.plan.disagreements == ()
    assert MODEL.tcp(plan.trajectory.end).distance(RIGHT) < 1e-3
    assert np.array_equal(plan.path[0], START)
    (entry,) = [one for one in cell.journal.take() if isinstance(one, Plan)]
    assert (entry.planner, entry.outcome) == (name, "found")
    assert plan.checks <= entry.checks < plan.checks + 10


@pytest.mark.parametrize("name", OMPL)
def test_each_planner_carries_upright(name: str) -> None:
    upright = (UprightConstraint(radians(20)),)
    cell = Cell(walled(0.15))
    plan, _ = run(cell.plan.solve(replace(request(name), constraints=upright)))
    constraints = PathConstraints(MODEL, upright)
    assert plan.planner == name
    assert all(constraints.hold(q) for q in plan.trajectory.position)
    assert cell.plan.disagreements == ()


@pytest.mark.parametrize("name", OMPL)
@pytest.mark.parametrize("constraints", [(), (UprightConstraint(radians(20)),)], ids=["free", "upright"])
def test_a_search_ends_with_its_budget(name: str, constraints: tuple[UprightConstraint, ...]) -> None:
    with pytest.raises(Failure) as failed:
        solver().solve(replace(request(name, 60), constraints=constraints), 1)
    assert failed.value.cause == planning.BUDGET
    spent = failed.value.evidence["checks"]
    assert isinstance(spent, int) and 60 <= spent < 400


@pytest.mark.slow
def test_plans_do_not_depend_on_what_memory_held_before() -> None:
    names = ("rrt_star", "informed_rrt_star", "bit_star", "aorrtc", "prm_star")
    first = [found(name, 2).checks for name in names]
    sizes = np.random.default_rng(0).integers(10, 400, 40_000).tolist()
    held = [bytes(size) for size in sizes][::2]
    assert [solver().solve(request(name), 2).checks for name in names] == first
    assert len(held) == 20_000


@pytest.mark.parametrize("name", OMPL)
def test_another_seed_is_another_search(name: str) -> None:
    first, second = [
        (plan.checks, plan.trajectory.position.tobytes()) for plan in (found(name, 1), found(name, 2))
    ]
    assert first != second


def test_what_is_shortest_already_is_not_searched() -> None:
    at = START + 0.05
    for name in ("bit_star", "aorrtc", "prm_star"):
        plan = solver().solve(Request(JointGoal(at), planner=name), 1)
        assert (plan.planner, len(plan.path)) == (name, 2)
        assert plan.checks < 100


@pytest.mark.parametrize("name", OMPL)
def test_who_is_there_already_has_a_plan(name: str) -> None:
    plan = solver().solve(Request(JointGoal(START), planner=name), 1)
    assert plan.planner == name and np.array_equal(plan.trajectory.end, START)


def test_aorrtc_is_no_longer_than_what_it_begins_with() -> None:
    lengths = {name: [_length(found(name, k)) for k in range(3)] for name in ("rrt_connect", "aorrtc")}
    assert sum(lengths["aorrtc"]) < sum(lengths["rrt_connect"])


def _length(plan: MotionPlan) -> float:
    return float(np.linalg.norm(np.diff(plan.path, axis=0), axis=1).sum())


def test_searches_leave_nothing_of_ompl_behind() -> None:
    for name in OMPL:
        found(name, 1)
    gc.collect()
    left = [type(one).__name__ for one in gc.get_objects() if type(one).__module__ == ompl_planners.__name__]
    assert not {"_Validator", "_Projection", "_OmplSearch"} & set(left)


def plan_digests() -> list[tuple[str, int, str]]:
    """Name, collision checks and digest of the plan of each planner."""
    plans = {name: found(name, 2) for name in OMPL}
    return [
        (name, plan.checks, sha256(plan.trajectory.position.tobytes()).hexdigest())
        for name, plan in plans.items()
    ]


def test_plans_are_the_same_in_every_process(elsewhere: OtherProcess) -> None:
    assert elsewhere.call(plan_digests) == plan_digests()


# Where it is chosen.


def test_a_request_counts_before_overrides_and_these_before_the_usual_planner() -> None:
    assert solver(planner="lbkpiece").solve(replace(request(""), planner=""), 1).planner == "lbkpiece"
    assert solver(planner="lbkpiece").solve(request("bkpiece"), 1).planner == "bkpiece"
    outer, inner = PlannerOverrides(planner="bit_star"), PlannerOverrides(planner="aorrtc")
    assert (outer & inner).planner == "aorrtc" and (outer & PlannerOverrides(seed=1)).planner == "bit_star"
    assert outer.of(request("")).planner == "bit_star"
    assert outer.of(request("kpiece")).planner == "kpiece"


def test_auto_and_straight_lines_are_as_ever() -> None:
    assert solver().solve(request(""), 1).planner == "RRTConnect"
    assert solver(planner="bit_star").solve(request(AUTO), 1).planner == "RRTConnect"
    lifted = solver(planner="bit_star").solve(Request(OffsetGoal((0.0, 0.0, 0.05))), 1)
    assert lifted.planner == "line"


@pytest.mark.parametrize(
    "name, meant",
    [
        ("RRTstar", "rrt_star"),
        ("RRT*", "rrt_star"),
        ("RRTConnect", "rrt_connect"),
        ("InformedRRTstar", "informed_rrt_star"),
        ("BIT*", "bit_star"),
        ("KPIECE1", "kpiece"),
        ("LBKPIECE1", "lbkpiece"),
        ("geometric::RRTConnect", "rrt_connect"),
        ("AORRTC", "aorrtc"),
        ("rrt_conect", "rrt_connect"),
    ],
)
def test_other_spellings_are_told_the_name(name: str, meant: str) -> None:
    with pytest.raises(PicktreeError) as wrong:
        solver().solve(request(name), 1)
    assert str(wrong.value) == f"there is no planner {name!r}: did you mean {meant!r}?"


SCENE = """\
picktree: 1
kind: scene
base: three_bins
"""
ROBOT = load_robot("panda").text


def test_a_scene_says_its_planner_and_a_robot_unless_the_scene_does(tmp_path: Path) -> None:
    robot = tmp_path / "panda.yaml"
    robot.write_text(ROBOT + "planner: bkpiece\n")
    for planner, used in (("", "bkpiece"), ("planner: aorrtc\n", "aorrtc"), ("planner: auto\n", "direct")):
        scene = tmp_path / "scene.yaml"
        scene.write_text(f"{SCENE}robot: panda.yaml\n{planner}")
        query = PlanQuery(str(scene), "home", "observe")
        found = plan_in_scene(query).found
        assert found is not None and found.planner == used
        found = plan_in_scene(replace(query, planner="lbkpiece")).found
        assert found is not None and found.planner == "lbkpiece"


def test_an_unknown_planner_is_a_fault_at_its_place(tmp_path: Path) -> None:
    scene, robot, mission = (tmp_path / f"{name}.yaml" for name in ("scene", "robot", "mission"))
    scene.write_text(f"{SCENE}planner: RRTstar\n")
    robot.write_text(ROBOT + "planner: bitstar\n")
    mission.write_text(
        "picktree: 1\nkind: mission\nscene: three_bins\ntrees:\n"
        "  Main:\n    PlanWith: {planner: AORRT, do: {GoTo: {pose: home}}}\n"
    )
    report = check_files([scene, robot, mission], CHECKS)
    assert [str(fault) for fault in report.faults] == [
        f"{scene}:4:10: planner: there is no planner 'RRTstar' (did you mean 'rrt_star'?)",
        f"{robot}:{ROBOT.count(chr(10)) + 1}:10: planner: there is no planner 'bitstar' "
        "(did you mean 'bit_star'?)",
        f"{mission}:6:25: Main/PlanWith: port 'planner': there is no planner 'AORRT' "
        "(did you mean 'aorrtc'?)",
    ]
    assert [fault.code for fault in report.faults] == ["P108", "P108", "P240"]


MISSION = """\
picktree: 1
kind: mission
name: planners
scene: three_bins
goal: "true"
trees:
  Main:
    Sequence:
      - PlanWith: {planner: bit_star, do: {GoTo: {pose: observe}}}
      - GoTo: {pose: home}
"""


def test_plan_with_holds_for_its_sub_tree_and_the_log_names_the_planner(tmp_path: Path) -> None:
    (tmp_path / "planners.yaml").write_text(MISSION)
    request = RunRequest(tmp_path / "planners.yaml", backend="kinematic", out=tmp_path / "runs")
    result = Session(request).run()
    assert result.status == "success"
    with RunLog(result.log) as log:
        plans = [found.record.planner for found in log.plans()]
    assert plans == ["bit_star", "direct"]


# Planners of plug-ins.

STRAIGHT_UP = '''
"""A planner of one's own: over a point above the middle of the table."""

import numpy as np


def over(problem):
    while not problem.spent():
        middle = problem.rng.uniform(problem.lower, problem.upper)
        if problem.free(middle) and problem.edge(problem.start, middle):
            for goal in problem.goals:
                if problem.between(middle, goal):
                    return [problem.start, middle, goal]
    return None


def nowhere(problem):
    return [problem.start, problem.start + 1.0]


NO_FUNCTION = 3
'''
ENTRY_POINTS = """
[picktree.planners]
over = my_planners:over
nowhere = my_planners:nowhere
three = my_planners:NO_FUNCTION
missing = my_planners:missing
bit_star = my_planners:over
"""


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What pip leaves behind of a distribution with planners."""
    (tmp_path / "my_planners.py").write_text(STRAIGHT_UP)
    info = tmp_path / "my_planners-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-planners\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield
    sys.modules.pop("my_planners", None)


@pytest.mark.usefixtures("plug_in")
def test_a_planner_of_a_plug_in_is_used_by_its_name() -> None:
    cell = Cell(walled())
    plan, _ = run(cell.plan.solve(request("over")))
    assert plan.planner == "over" and cell.plan.disagreements == ()
    assert (
        solver().solve(request("over"), 5).path.tobytes() == solver().solve(request("over"), 5).path.tobytes()
    )
    with pytest.raises(Failure) as failed:
        solver().solve(request("over", 20), 1)
    assert failed.value.cause == planning.BUDGET


@pytest.mark.usefixtures("plug_in")
def test_a_plug_in_does_not_take_the_name_of_a_built_in_planner() -> None:
    assert (
        solver().solve(request("bit_star"), 3).path.tobytes()
        != solver().solve(request("over"), 3).path.tobytes()
    )


@pytest.mark.usefixtures("plug_in")
@pytest.mark.parametrize(
    "name, told",
    [
        ("nowhere", "the planner 'nowhere' returned a path that does not lead from the start to a goal"),
        ("three", "the planner 'three' (my_planners:NO_FUNCTION) must be a function that takes a "
            "SearchProblem"),
        ("missing", "the planner 'missing' (my_planners:missing) cannot be imported: "
            "module 'my_planners' has no attribute 'missing'"),
        ("ovr", "there is no planner 'ovr': did you mean 'over'?"),
    ],
)  # fmt: skip
def test_a_faulty_planner_is_one_clear_error(name: str, told: str) -> None:
    with pytest.raises(PicktreeError) as wrong:
        solver().solve(request(name), 1)
    assert str(wrong.value) == told
