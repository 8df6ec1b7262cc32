from .collision_checker import CollisionChecker as CollisionChecker
from .inverse_kinematics import InverseKinematics as InverseKinematics
from .motion_plans import MotionPlan as MotionPlan
from .path_search import SearchProblem as SearchProblem
from .requests import (
    BoxConstraint as BoxConstraint,
    HeldObject as HeldObject,
    JointGoal as JointGoal,
    LineGoal as LineGoal,
    NamedGoal as NamedGoal,
    OffsetGoal as OffsetGoal,
    PoseGoal as PoseGoal,
    RegionGoal as RegionGoal,
    Request as Request,
    Scaling as Scaling,
    UprightConstraint as UprightConstraint,
)
from .solver import RequestSolver as RequestSolver

# for other rooms
from .collision_checker import robot_geometry as robot_geometry, standing_pairs as standing_pairs
from .collision_model import CoalShapes as CoalShapes
from .limits import WORKSPACE_MARGIN as WORKSPACE_MARGIN, configuration_cost as configuration_cost
from .lookahead_planning import LookaheadResult as LookaheadResult, has_second_core as has_second_core
from .motion_plans import ContactPair as ContactPair, LegFailure as LegFailure
from .plan_quality import PlanQuality as PlanQuality
from .penetration_escape import EscapePath as EscapePath
from .plan_service import PlanService as PlanService
from .planning_failures import contact_lines as contact_lines
from .requests import (
    CARRYING_ACCELERATION as CARRYING_ACCELERATION,
    Constraint as Constraint,
    DEFAULT_CHECK_BUDGET as DEFAULT_CHECK_BUDGET,
    DIRECTIONS as DIRECTIONS,
    Direction as Direction,
    PlannerOverrides as PlannerOverrides,
    Target as Target,
)
from .scene_queries import SceneQueries as SceneQueries
from .solver import ReachResult as ReachResult
from .time_parameterization import time_corners as time_corners, time_smooth as time_smooth
from .trajectory_gate import JogCollisionCheck as JogCollisionCheck, TrajectoryGate as TrajectoryGate
