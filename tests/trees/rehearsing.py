"""Leaves with declarations of every sort, and a rehearsal of two texts."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from textwrap import dedent, indent
from typing import cast

from picktree.authoring.rehearsal import Rehearsal, rehearse
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.authoring.rehearsal.cases import CaseFile
from picktree.authoring.rehearsal.rehearsal import CaseResult
from picktree.files.yaml import Document, read_document
from picktree.robot import World
from picktree.trees import (
    ARM,
    CAMERA,
    GRIPPER,
    ConditionNode,
    Decorator,
    In,
    LeafFlow,
    Mission,
    Node,
    NodeStatus,
    Out,
    Skill,
    Steps,
    port,
)
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import ObjectId, grasp, perception, place, planning, safety

HERE = Path("cases.yaml")


class _Never(Skill, abstract=True):
    """A skill whose body must not run in a rehearsal."""

    def run(self, world: World) -> Steps:
        raise AssertionError("the body of a skill ran in a rehearsal")
        yield


class Look(_Never):
    """Looks."""

    objects: Out[list[ObjectId]] = port("what is to be done")
    expect: In[ObjectId] = port("what must be seen", default=ObjectId(""))
    causes = (perception.NOT_FOUND,)
    uses = (CAMERA,)

    flow = LeafFlow(fails_with="expect")


class Pick(_Never):
    """Takes an object."""

    object: In[ObjectId] = port("what to take")
    causes = (grasp.MISSED, grasp.SLIPPED, safety.ANY)
    uses = (ARM, GRIPPER)
    hand_after = "full"


class Put(_Never):
    """Puts an object into a bin."""

    object: In[ObjectId] = port("what to put")
    into: In[ObjectId] = port("the bin", default=ObjectId(""), names="bin")
    causes = (place.FULL, grasp.SLIPPED)
    uses = (ARM, GRIPPER)
    hand_after = "empty"


class Go(_Never):
    """Moves."""

    causes = (planning.NO_PATH, safety.ANY)
    uses = (ARM,)


class Retreat(_Never):
    """Gets clear, and acknowledges a safety stop."""

    drop: In[bool] = port("whether to open the hand", default=False)
    causes = (planning.NO_PATH, safety.ANY)
    uses = (ARM,)
    hand_after = "kept"

    flow = LeafFlow(hand_by=("drop", {True: "empty"}))


class Weigh(_Never):
    """Measures a weight."""

    weight: Out[float] = port("what it weighs", unit="N")
    sort: Out[str] = port("of what sort it is", choices=("light", "heavy"))
    causes = (perception.STALE,)


class Ready(ConditionNode):
    """Whether something outside is ready."""

    causes = (perception.STALE,)

    def answer(self, world: World) -> bool:
        raise AssertionError("a condition asked the world in a rehearsal")


class Maybe(Node):
    """A leaf of its own kind, which may skip."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        raise AssertionError("a leaf ran in a rehearsal")


class Peek(Decorator):
    """A node of somebody's own that asks the robot itself."""

    def on_tick(self) -> NodeStatus:
        at_rest = cast("World", self.world).control.at_rest
        return NodeStatus.SUCCESS if at_rest else NodeStatus.FAILURE


NODES: tuple[type[Node], ...] = (Look, Pick, Put, Go, Retreat, Weigh, Ready, Maybe, Peek)


@cache
def nodes() -> NodeRegistry:
    """These leaves and all that is installed; nobody adds to it."""
    return NodeRegistry(NODES)


def mission_of(trees: str, head: str = "") -> Mission:
    text = f"picktree: 1\nkind: mission\n{head}trees:\n{indent(dedent(trees).strip(), '  ')}\n"
    return parse_mission(text, Path("mission.yaml"), nodes())


def case_file(cases: str, mission: Mission) -> CaseFile:
    """The cases of a text that begins after `kind: cases`; it must be without errors."""
    found = examine_cases(_document(cases), mission)
    assert [str(fault) for fault in found.errors] == []
    return found.cases


def faults_of(cases: str, mission: Mission | None) -> list[str]:
    """Code and text of every fault of such a text; its first line is line 3 of the file."""
    found = examine_cases(_document(cases), mission)
    return [f"{fault.code} {str(fault).removeprefix('cases.yaml:')}" for fault in found.faults]


def play(trees: str, cases: str, head: str = "") -> Rehearsal:
    mission = mission_of(trees, head)
    return rehearse(mission, case_file(cases, mission))


def play_one(trees: str, case: str, head: str = "") -> CaseResult:
    """The one case of a text that stands below its name."""
    text = "cases:\n  it:\n" + indent(dedent(case).strip(), "    ")
    return play(trees, text, head).cases[0]


def said(case: CaseResult) -> list[str]:
    """The differences, without the place in the file."""
    return [str(difference).split(": ", 1)[1] for difference in case.differences]


def runs(case: CaseResult) -> list[str]:
    """`tick-last node outcome` of every leaf's run, the node by its name."""
    return [
        f"{run.tick}-{run.last} {run.path.rpartition('/')[2]} {run.cause or run.outcome}" for run in case.runs
    ]


def _document(cases: str) -> Document:
    return read_document(HERE, "cases", "picktree: 1\nkind: cases\n" + dedent(cases))
