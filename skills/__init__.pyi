from .feed import AwaitItems as AwaitItems, ExchangeBin as ExchangeBin
from .go_to import GoTo as GoTo
from .grasp import Grasp as Grasp
from .gripper import CloseGripper as CloseGripper, OpenGripper as OpenGripper
from .insert import Insert as Insert
from .jog import Jog as Jog
from .nodes import NODES as NODES
from .observe import Observe as Observe, Present as Present
from .pick_any import PickAny as PickAny
from .place import Place as Place
from .push import Push as Push
from .stir import Stir as Stir
from .survey import Survey as Survey
from .touch_target import TouchTarget as TouchTarget
from .watch_scene import WatchScene as WatchScene
