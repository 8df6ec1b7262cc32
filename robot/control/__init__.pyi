from .commands import Twist as Twist
from .compliant_motion import (
    CartesianStiffness as CartesianStiffness,
    CompliantMotion as CompliantMotion,
    ContactState as ContactState,
    GuardedMoveResult as GuardedMoveResult,
)
from .jog_motion import JogFeedback as JogFeedback, JogResult as JogResult
from .safety_monitor import SafetyMonitor as SafetyMonitor

# for other rooms
from .commands import (
    ContactThresholds as ContactThresholds,
    Doing as Doing,
    JointImpedanceResult as JointImpedanceResult,
    MAX_TWIST_ANGULAR_SPEED as MAX_TWIST_ANGULAR_SPEED,
    MAX_TWIST_SPEED as MAX_TWIST_SPEED,
)
from .contact_detection import ContactDetector as ContactDetector
from .control_loop import (
    ControlLoop as ControlLoop,
    ControlLoopState as ControlLoopState,
    MAX_UNATTENDED_MOTION as MAX_UNATTENDED_MOTION,
)
from .external_torque import static_external_torque as static_external_torque
from .gripper_motion import (
    GripperProgress as GripperProgress,
    GripperControl as GripperControl,
    OPENING_FORCE as OPENING_FORCE,
)
from .joint_controllers import HoldController as HoldController
from .force_guard import above_limit as above_limit
from .motions import ArmMotion as ArmMotion
from .payload_estimate import (
    MassEstimate as MassEstimate,
    Payload as Payload,
    SlipDetector as SlipDetector,
    WristSample as WristSample,
    estimate_moving_mass as estimate_moving_mass,
    point_velocity as point_velocity,
    wrist_sample as wrist_sample,
)
from .peg_insertion import (
    BelievedHole as BelievedHole,
    ExtractionMotion as ExtractionMotion,
    HeldPeg as HeldPeg,
    InsertionMotion as InsertionMotion,
    InsertionParameters as InsertionParameters,
    Search as Search,
)
from .soft_limits import distance_to_workspace_edge as distance_to_workspace_edge
from .trajectory_motion import FollowedPath as FollowedPath, Watch as Watch
