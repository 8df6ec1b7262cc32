"""Everything that a plug-in's file needs, from one import: `from picktree.skills.plugin import Skill, port`.

Each name is imported on first use, so that a skill does not load what only other skills need.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    pass

_NAMES: Final = {
    "trees": (
        "Skill", "Steps", "Doing", "ARM", "GRIPPER", "CAMERA", "ConditionNode", "Decorator",
        "ControlNode", "NodeStatus", "In", "Out", "port", "child", "children", "optional_child",
        "table",
    ),
    "world": (
        "Cause", "Failure", "register_cause", "perception", "planning", "grasp", "place", "insert",
        "push", "control", "safety", "world", "feed", "tree", "internal", "BeliefObject",
        "ObjectId", "Pose", "Wrench", "Array", "Trajectory",
    ),
    "robot": ("World",),
    "robot.planning": (
        "NamedGoal", "JointGoal", "PoseGoal", "RegionGoal", "LineGoal", "OffsetGoal",
        "UprightConstraint", "BoxConstraint", "Request", "HeldObject", "Scaling", "SearchProblem",
    ),
    "robot.control": (
        "CompliantMotion", "ContactState", "CartesianStiffness", "Twist", "GuardedMoveResult",
        "JogFeedback", "JogResult",
    ),
}  # fmt: skip
"""Names by the door that has them."""
_DOORS: Final = {name: door for door, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Return what a plug-in imports. Raises AttributeError for another name."""
    if name not in _DOORS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"picktree.{_DOORS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_DOORS)
