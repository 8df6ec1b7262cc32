from .grasps import grasp_candidates as grasp_candidates
from .replanning import follow_with_replanning as follow_with_replanning

# for other rooms
from . import (
    bin_belief as bin_belief,
    closed_loop_pushing as closed_loop_pushing,
    heap_pick as heap_pick,
    held_object as held_object,
    insertion as insertion,
    object_pick as object_pick,
    object_placement as object_placement,
    pick_candidates as pick_candidates,
    release_poses as release_poses,
    retreat as retreat,
)
from .grasps import MIN_SPARE_OPENING as MIN_SPARE_OPENING
from .grip_force import opening_force as opening_force
from .heap_stirring import stir as stir
from .pick_place_motions import DOWNWARDS as DOWNWARDS, withdraw as withdraw
from .presentation import PresentTask as PresentTask, present as present
from .travel_time import travel_order as travel_order
