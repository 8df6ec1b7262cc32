from .backends import build_hardware as build_hardware
from .checkpoints import Backend as Backend
from .cell_file import cell_file as cell_file
from .fault_injector import FaultInjector as FaultInjector
from .fault_loading import load_faults as load_faults, parse_faults as parse_faults
from .scorer import score as score

# for other rooms
from . import checkpoints as checkpoints, fault_entries as fault_entries
from .backends import Simulation as Simulation
from .belt_feed import BeltDrive as BeltDrive, BeltState as BeltState, check_belts as check_belts
from .device_faults import DeviceFaults as DeviceFaults, jam_command as jam_command
from .fault_injector import FaultState as FaultState, new_states as new_states
from .fault_loading import check_faults as check_faults
from .feed_cell import LightCurtain as LightCurtain, Zone as Zone
from .feeder import Feeder as Feeder, FeederState as FeederState, has_feeder as has_feeder
from .footprints import (
    Footprint as Footprint,
    distance as distance,
    floor_height as floor_height,
    footprint as footprint,
    support_height as support_height,
)
from .heap_spawning import Sticker as Sticker, check_contained as check_contained, pile_walls as pile_walls
from .inventory import Inventory as Inventory, InventoryState as InventoryState
from .nominal_parts import (
    NominalPart as NominalPart,
    make_nominal as make_nominal,
    nominal_scene as nominal_scene,
    require_known as require_known,
)
from .planted_obstacles import (
    FreeSpaceCheck as FreeSpaceCheck,
    HiddenObstacles as HiddenObstacles,
    MIN_OBSTACLE_CLEARANCE as MIN_OBSTACLE_CLEARANCE,
)
from .scorer import (
    ItemScore as ItemScore,
    MAX_REST_SPEED as MAX_REST_SPEED,
    Score as Score,
    rests as rests,
)
from .sensor_noise import (
    RobotSensorNoise as RobotSensorNoise,
    mislabelled as mislabelled,
    noisy_colour as noisy_colour,
    noisy_depth as noisy_depth,
)
from .spawn import (
    MIN_ITEM_CLEARANCE as MIN_ITEM_CLEARANCE,
    SpawnedItem as SpawnedItem,
    displace_fixtures as displace_fixtures,
    enlarged_item as enlarged_item,
    placed_item as placed_item,
    spawn_items as spawn_items,
    walls as walls,
)
from .truth import (
    HoleSeating as HoleSeating,
    HoledFixtures as HoledFixtures,
    TrueBody as TrueBody,
    TrueObstacle as TrueObstacle,
)
