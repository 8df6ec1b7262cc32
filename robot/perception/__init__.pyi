from .pipeline import WORK_PER_TICK as WORK_PER_TICK, Perception as Perception

# for other rooms
from . import segmentation as segmentation
from .backdrop import BackgroundModel as BackgroundModel, table_of as table_of
from .camera_geometry import (
    PosedCamera as PosedCamera,
    depth_noise as depth_noise,
    noise_factor as noise_factor,
)
from .data_association import ObservationSummary as ObservationSummary, update_belief as update_belief
from .heap_mapping import put_heap as put_heap, update_heap as update_heap
from .held_thing import HeldView as HeldView
from .hole_mouths import detect_hole as detect_hole
from .known_object_fitting import TrackedSighting as TrackedSighting
from .picture_memory import PictureMemory as PictureMemory, PictureState as PictureState
from .resting_poses import catalogue_poses as catalogue_poses
from .robot_mask import RobotMask as RobotMask, hidden_shares as hidden_shares
from .segmentation import LABEL_NAMES as LABEL_NAMES, connected_patches as connected_patches
from .view import BinView as BinView, PerceivedView as PerceivedView
