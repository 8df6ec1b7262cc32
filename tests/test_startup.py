"""A start loads what it uses: large libraries by command, and nothing that only other commands need."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from picktree import recovery, skills
from picktree.files.disk_cache import VARIABLE

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
LARGE = {
    "PIL", "coal", "cv2", "fcl", "google", "lsprotocol", "matplotlib", "mcap", "numpy", "ompl", "orjson",
    "pinocchio", "py_trees", "pybullet", "pydantic", "pygls", "rich", "scipy", "toppra", "trimesh", "yaml",
}  # fmt: skip
"""Libraries whose packages take milliseconds or more to import."""
COMMAND = """
import os, sys
from picktree import __main__

def shown():
    print(*sorted(sys.modules), file=sys.stderr)

class BeforeTheFirstTick:
    def find_spec(self, name, path, target=None):
        if name == "picktree.session.session":
            sys.meta_path.remove(self)
            from picktree.session import Execution
            def tick(execution):
                shown()
                os._exit(0)
            Execution.tick = tick

sys.meta_path.insert(0, BeforeTheFirstTick())
try:
    __main__.main()
except SystemExit as end:
    shown()
    raise
"""
"""Program that runs `picktree` to its end, or up to the first tick, and writes the loaded modules."""


def loaded(*arguments: str) -> set[str]:
    """Modules that a command loads when it is started again: the cache has what it computed first."""
    found: set[str] = set()
    for _ in range(2 if arguments[0] in ("run", "check") else 1):
        ran = subprocess.run([sys.executable, "-c", COMMAND, *arguments], capture_output=True, text=True)
        assert ran.returncode == 0, ran.stderr
        found = set(ran.stderr.splitlines()[-1].split())
    return found


@pytest.mark.parametrize(
    ("arguments", "large"),
    [
        (["--help"], set[str]()),
        (["cache"], {"pydantic"}),  # by which typer reads options
        (["check", str(EXAMPLES / "sort_by_colour.yaml")], {"numpy", "py_trees", "pydantic", "yaml"}),
    ],
    ids=["help", "cache", "check"],
)
def test_a_command_loads_these_large_libraries(arguments: list[str], large: set[str]) -> None:
    assert loaded(*arguments) & LARGE == large


@pytest.mark.parametrize("backend", ["physics", "kinematic"])
def test_a_run_loads_these_large_libraries_before_its_first_tick(backend: str, tmp_path: Path) -> None:
    mission = str(EXAMPLES / "sort_by_colour.yaml")
    found = loaded("run", mission, "--backend", backend, "--out", str(tmp_path))
    # Neither ompl, before the first search, nor scipy, toppra and trimesh, of which single modules suffice.
    assert found & LARGE == {
        "coal", "cv2", "fcl", "google", "mcap", "numpy", "orjson", "pinocchio", "py_trees", "pybullet",
        "pydantic", "yaml",
    }  # fmt: skip
    unused = {name for name in found if name.startswith(("picktree.authoring.", "picktree.analysis."))}
    # A run checks its mission as `check` does.
    checks = ("picktree.authoring.check", "picktree.authoring.lint")
    assert not {name for name in unused if not name.startswith(checks)}


def test_a_check_loads_the_nodes_of_its_mission_and_no_others() -> None:
    found = loaded("check", str(EXAMPLES / "one_pick.yaml"))
    nodes = {name for name in found if name.startswith(("picktree.skills.", "picktree.recovery."))}
    assert nodes == {f"picktree.skills.{name}" for name in ("go_to", "grasp", "observe", "place")}
    unused = ("authoring.rehearsal", "authoring.schema.mission", "manipulation.push", "simulation")
    assert not {name for name in found if name.startswith(tuple(f"picktree.{each}" for each in unused))}


def test_who_only_hands_jobs_to_workers_loads_no_large_library() -> None:
    modules = "picktree.apps.batch.local_executor, picktree.apps.batch.ray_executor"
    program = f"import sys, {modules}; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert set(ran.stdout.split()) & LARGE == set(), ran.stderr


@pytest.mark.parametrize("package", [recovery, skills])
def test_the_door_of_a_package_has_its_nodes_under_their_ids(package: ModuleType) -> None:
    """The registry looks there for the one node that a mission names."""
    assert [getattr(package, node.declaration.id) for node in package.NODES] == list(package.NODES)
    with pytest.raises(AttributeError, match="Dance"):
        _ = package.Dance


def test_no_garbage_is_looked_for_as_a_command_ends() -> None:
    program = "import atexit, gc, sys; from picktree import __main__; sys.argv = ['picktree', '--version']\n"
    program += "atexit.register(lambda: print(gc.get_freeze_count() > 10_000)); __main__.main()"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout.splitlines()[-1]) == (0, "True")


def test_help_builds_only_the_command_that_is_called() -> None:
    program = "import sys; from picktree.apps.cli import app; built = []; make = app._built\n"
    program += "app._built = lambda name: built.append(name) or make(name)\n"
    program += "app.answer(sys.argv[1:]); print(built)"
    for arguments, built in (["--help"], []), (["run", "--help"], ["run"]), (["batch", "--help"], ["batch"]):
        ran = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True)
        assert ran.stdout.splitlines()[-1] == str(built)


PARTS = """
import sys
import numpy as np
import picktree
{first}
from picktree.files.library_parts import library_part
import picktree.robot.planning.inverse_kinematics as descent
import picktree.robot.perception.data_association as association
import picktree.robot.planning.path_curves as curves
import picktree.robot.planning.time_parameterization as profile
from picktree.world import convex_hull
hull = convex_hull(np.random.default_rng(0).random((20, 3)))
import scipy.linalg, scipy.linalg.lapack, scipy.optimize, scipy.spatial
import toppra, toppra.algorithm, toppra.constraint
print(descent.dposv is scipy.linalg.lapack.dposv, curves.dgtsv is scipy.linalg.lapack.dgtsv)
print(association.linear_sum_assignment is scipy.optimize.linear_sum_assignment)
print(type(hull) is scipy.spatial.ConvexHull, issubclass(profile._Rows, toppra.constraint.LinearConstraint))
path = toppra.SplineInterpolator([0, 0.5, 1], [[0.0, 0.0], [1.0, 0.3], [0.5, 1.0]])
limits = [
    toppra.constraint.JointVelocityConstraint(np.array([[-1.0, 1.0]] * 2)),
    toppra.constraint.JointAccelerationConstraint(np.array([[-2.0, 2.0]] * 2)),
]
print(toppra.algorithm.TOPPRA(limits, path, solver_wrapper="seidel").compute_trajectory().duration > 0)
from toppra.constraint.constraint import ConstraintType
print(ConstraintType is toppra.constraint.ConstraintType)
"""


@pytest.mark.parametrize("first", ["", "import scipy.linalg, scipy.optimize, scipy.spatial, toppra"])
def test_parts_of_libraries_are_those_that_everybody_else_gets(first: str) -> None:
    program = PARTS.replace("{first}", first)
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert set(ran.stdout.split()) == {"True"}


def test_a_library_that_is_arranged_otherwise_is_imported_as_usual() -> None:
    program = "from picktree.files.library_parts import library_part as part\n"
    program += "a = part('scipy.optimize._gone', 'scipy.optimize.nnls')\n"
    program += "b = part('scipy.linalg._flapack', 'math.hypot')\n"
    program += "from scipy.optimize import nnls; from math import hypot; print(a is nnls, b is hypot)"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.stdout.split() == ["True", "True"]


def test_the_cache_of_the_tests_is_not_the_users() -> None:
    assert ".pytest_cache" in os.environ[VARIABLE]


@pytest.mark.parametrize("command", ["check", "explain", "report"])
def test_a_command_on_files_and_logs_starts_without_physics_and_planners(
    command: str, troubled_log: Path, tmp_path: Path
) -> None:
    """Imports of these libraries fail, as on a machine for analysts that does not have them."""
    program = "import sys; sys.modules.update(dict.fromkeys(('pybullet', 'ompl', 'toppra')))\n"
    program += "from picktree import __main__; __main__.main()"
    arguments = {
        "check": [str(EXAMPLES / "sort_by_colour.yaml")],
        "explain": [str(troubled_log)],
        "report": [str(troubled_log), "-o", str(tmp_path / "report.html")],
    }[command]
    ran = subprocess.run([sys.executable, "-c", program, command, *arguments], capture_output=True, text=True)
    assert "Traceback" not in ran.stderr and ran.returncode in (0, 1), ran.stderr
    assert ran.stdout
