"""Skills that come with picktree: leaves that move the robot or look through its cameras."""

from ..trees.node import Node
from .await_items import AwaitItems
from .exchange_bin import ExchangeBin
from .go_to import GoTo
from .grasp import Grasp
from .gripper import CloseGripper, OpenGripper
from .insert import Insert
from .jog import Jog
from .observe import Observe
from .place import Place
from .push import Push
from .survey import Survey
from .touch_target import TouchTarget
from .watch_scene import WatchScene

NODES: tuple[type[Node], ...] = (
    Observe,
    Grasp,
    Place,
    Insert,
    Push,
    GoTo,
    OpenGripper,
    CloseGripper,
    AwaitItems,
    ExchangeBin,
    Jog,
    Survey,
    TouchTarget,
    WatchScene,
)
"""Node classes of the entry point `picktree.nodes`."""
