"""picktree: declarative behaviour-tree skills for robot arms that sort many items for hours.

    import picktree as pt

    with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
        cell.run(pt.Observe(camera="overhead"))
        block = cell.belief.find(colour="red", kind="block")
        print(cell.run(pt.Grasp(object=block.id)))

Cell        robot, world and simulation: run single nodes, plan motions, look at belief and pictures
PoseGoal    goal of a planned motion: poses of the tool in the world
Mission     a mission made of nodes; `load` reads one from a file; check, render, save
Tree        a named tree with ports, whose calls are nodes: SubTree(tree, item="{item}")
run         run a mission to its end; returns a Run: result, explain, show, report
batch       run a mission with many seeds and settings; returns a Batch: summary, compare
nodes       all nodes by their IDs, those of plug-ins, too; the most used ones are here as well:
            Observe, Grasp, Place, Insert, Push, Sequence, Fallback, ForEach, Recover, SubTree

Packages, whose names docs/doors.md lists:

picktree.trees               language of missions: nodes, ports, loading, running
picktree.skills, .recovery   skills and recovery nodes; picktree.skills.plugin has what a plug-in needs
picktree.world               belief (PlanningScene), causes of failures, shapes, poses; .scene, .robot_model
picktree.robot.planning      motion requests, solver, collision checker, inverse kinematics
picktree.robot.manipulation  grasp candidates, steps of picking, placing, inserting and pushing
picktree.robot.control, .perception, .calibration
picktree.simulation          backends, injected faults, scorer of a run
picktree.session             one run: Session, observers, debugger, resume
picktree.logs, .analysis     reader of logs (RunLog); explain, compare, report, render
picktree.authoring           check, lint, rehearsal, XML

Lengths are m, angles rad, forces N, times simulated s, unless a text has a unit: "30 mm". Bad input raises
PicktreeError with a sentence for people, a wrong argument of a node TypeError. More: docs/python.md.
"""

# pyright: reportUnsupportedDunderAll=false
# The names are imported on request; __init__.pyi has them for editors.

from __future__ import annotations

from os.path import realpath

# An editable install finds the package through the link links/picktree. Its files keep their own paths, in
# which editors set breakpoints.
__path__[:] = map(realpath, __path__)
__file__ = realpath(__file__)

from picktree.files import pin  # noqa: E402 - it gets the real path, too

pin()  # before any library that computes is loaded

__all__ = [
    "Batch",
    "Cell",
    "Fallback",
    "ForEach",
    "Grasp",
    "Insert",
    "Mission",
    "Observe",
    "PicktreeError",
    "Place",
    "PoseGoal",
    "Push",
    "Recover",
    "Run",
    "Sequence",
    "SubTree",
    "Tree",
    "__version__",
    "batch",
    "load",
    "nodes",
    "run",
]

_DOORS = {
    "Batch": ("apps.api", "BatchResult"),
    "Cell": ("apps.api", "Cell"),
    "Mission": ("apps.api", "Mission"),
    "PicktreeError": ("files", "PicktreeError"),
    "PoseGoal": ("robot.planning", "PoseGoal"),
    "Run": ("apps.api", "MissionRun"),
    "Tree": ("trees", "TreeDefinition"),
    "batch": ("apps.api", "batch"),
    "load": ("apps.api", "load"),
    "run": ("apps.api", "run"),
}
"""Door and name there of the names that are no nodes. They are imported on request: the command line must
answer at once."""


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name == "__version__":
        from importlib.metadata import version

        return version("picktree")
    if name == "nodes":
        return import_module(".apps.api.nodes", __name__)
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    door, known_as = _DOORS.get(name, ("apps.api.nodes", name))
    found = getattr(import_module(f".{door}", __name__), known_as)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__doc__", "__file__", "__name__", "__path__"])
