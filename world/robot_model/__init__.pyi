from .description import RobotDescription as RobotDescription
from .model import RobotModel as RobotModel
from .robot_file import load_robot as load_robot, parse_robot as parse_robot

# for other rooms
from . import (
    gripper_mounting as gripper_mounting,
    link_solids as link_solids,
    robot_file as robot_file,
    urdf_parser as urdf_parser,
)
from .description import (
    GripperDescription as GripperDescription,
    GripperSettings as GripperSettings,
    JointLimits as JointLimits,
    tool_outline as tool_outline,
)
from .finger_linkage import (
    LinkageFingers as LinkageFingers,
    SliderPair as SliderPair,
    fingers_of as fingers_of,
)
from .joint_limits import (
    DEGREES_HINT as DEGREES_HINT,
    JointExcess as JointExcess,
    format_joint_value as format_joint_value,
    is_hinge as is_hinge,
    joint_excesses as joint_excesses,
)
from .link_solids import (
    LinkShape as LinkShape,
    fingerprint as fingerprint,
    link_shapes as link_shapes,
    refuse_mesh as refuse_mesh,
    refuse_size as refuse_size,
)
from .model import (
    LIMIT_RESERVE as LIMIT_RESERVE,
    TCP_FRAME as TCP_FRAME,
    beyond_flange as beyond_flange,
    joint_frame as joint_frame,
    link_frame as link_frame,
    pose_of as pose_of,
    se3 as se3,
)
from .urdf_faults import MOVING as MOVING, UrdfError as UrdfError
from .robot_schema import LinkageFile as LinkageFile, RobotFile as RobotFile
