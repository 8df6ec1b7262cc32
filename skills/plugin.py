"""Everything that a plug-in's file needs, from one import: `from picktree.skills.plugin import Skill, port`.

Names stay here when the modules behind them move. Each is imported on first use, so that a skill does not
load what only other skills need.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from ..robot.control.commands import Twist as Twist
    from ..robot.control.compliant_motion import CartesianStiffness as CartesianStiffness
    from ..robot.control.compliant_motion import CompliantMotion as CompliantMotion
    from ..robot.control.compliant_motion import ContactState as ContactState
    from ..robot.control.compliant_motion import GuardedMoveResult as GuardedMoveResult
    from ..robot.control.jog_motion import JogFeedback as JogFeedback
    from ..robot.control.jog_motion import JogResult as JogResult
    from ..robot.planning.path_search import SearchProblem as SearchProblem
    from ..robot.planning.requests import BoxConstraint as BoxConstraint
    from ..robot.planning.requests import HeldObject as HeldObject
    from ..robot.planning.requests import JointGoal as JointGoal
    from ..robot.planning.requests import LineGoal as LineGoal
    from ..robot.planning.requests import NamedGoal as NamedGoal
    from ..robot.planning.requests import OffsetGoal as OffsetGoal
    from ..robot.planning.requests import PoseGoal as PoseGoal
    from ..robot.planning.requests import RegionGoal as RegionGoal
    from ..robot.planning.requests import Request as Request
    from ..robot.planning.requests import Scaling as Scaling
    from ..robot.planning.requests import UprightConstraint as UprightConstraint
    from ..robot.world import World as World
    from ..trees.decorators import Decorator as Decorator
    from ..trees.flow import NodeStatus as NodeStatus
    from ..trees.leaves import ConditionNode as ConditionNode
    from ..trees.node import ControlNode as ControlNode
    from ..trees.ports import In as In
    from ..trees.ports import Out as Out
    from ..trees.ports import child as child
    from ..trees.ports import children as children
    from ..trees.ports import optional_child as optional_child
    from ..trees.ports import port as port
    from ..trees.ports import table as table
    from ..trees.skill import ARM as ARM
    from ..trees.skill import CAMERA as CAMERA
    from ..trees.skill import GRIPPER as GRIPPER
    from ..trees.skill import Doing as Doing
    from ..trees.skill import Skill as Skill
    from ..trees.skill import Steps as Steps
    from ..world.causes import Cause as Cause
    from ..world.causes import Failure as Failure
    from ..world.causes import control as control
    from ..world.causes import feed as feed
    from ..world.causes import grasp as grasp
    from ..world.causes import insert as insert
    from ..world.causes import internal as internal
    from ..world.causes import perception as perception
    from ..world.causes import place as place
    from ..world.causes import planning as planning
    from ..world.causes import push as push
    from ..world.causes import register_cause as register_cause
    from ..world.causes import safety as safety
    from ..world.causes import tree as tree
    from ..world.causes import world as world
    from ..world.planning_scene import BeliefObject as BeliefObject
    from ..world.values import Array as Array
    from ..world.values import ObjectId as ObjectId
    from ..world.values import Pose as Pose
    from ..world.values import Trajectory as Trajectory
    from ..world.values import Wrench as Wrench

_NAMES: Final = {
    "trees.skill": ("Skill", "Steps", "Doing", "ARM", "GRIPPER", "CAMERA"),
    "trees.leaves": ("ConditionNode",),
    "trees.decorators": ("Decorator",),
    "trees.node": ("ControlNode",),
    "trees.flow": ("NodeStatus",),
    "trees.ports": ("In", "Out", "port", "child", "children", "optional_child", "table"),
    "world.causes": (
        "Cause", "Failure", "register_cause", "perception", "planning", "grasp", "place", "insert", "push",
        "control", "safety", "world", "feed", "tree", "internal",
    ),
    "robot.world": ("World",),
    "world.planning_scene": ("BeliefObject",),
    "world.values": ("ObjectId", "Pose", "Wrench", "Array", "Trajectory"),
    "robot.planning.requests": (
        "NamedGoal", "JointGoal", "PoseGoal", "RegionGoal", "LineGoal", "OffsetGoal", "UprightConstraint",
        "BoxConstraint", "Request", "HeldObject", "Scaling",
    ),
    "robot.planning.path_search": ("SearchProblem",),
    "robot.control.compliant_motion": (
        "CompliantMotion", "ContactState", "CartesianStiffness", "GuardedMoveResult",
    ),
    "robot.control.commands": ("Twist",),
    "robot.control.jog_motion": ("JogFeedback", "JogResult"),
}  # fmt: skip
"""Names by their module."""
_MODULES: Final = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Return what a plug-in imports. Raises AttributeError for another name."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"...{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(_MODULES)
