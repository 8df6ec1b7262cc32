from .backend import PhysicsHardware as PhysicsHardware

# for other rooms
from .bodies import ItemShapes as ItemShapes, add_item as add_item, add_obstacle as add_obstacle
from .engine import Client as Client, pb as pb
from .engine_urdf import patched_urdf as patched_urdf
from .rgbd_camera import (
    CameraRenderer as CameraRenderer,
    RenderedImage as RenderedImage,
    StaticScene as StaticScene,
    in_front as in_front,
)
from .robot_body import RobotBody as RobotBody
