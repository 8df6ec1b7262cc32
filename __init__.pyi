from .apps.api import BatchResult as Batch
from .apps.api import Cell as Cell
from .apps.api import Mission as Mission
from .apps.api import MissionRun as Run
from .apps.api import batch as batch
from .apps.api import load as load
from .apps.api import nodes as nodes
from .apps.api import run as run
from .apps.api.nodes import Fallback as Fallback
from .apps.api.nodes import ForEach as ForEach
from .apps.api.nodes import Grasp as Grasp
from .apps.api.nodes import Insert as Insert
from .apps.api.nodes import Observe as Observe
from .apps.api.nodes import Place as Place
from .apps.api.nodes import Push as Push
from .apps.api.nodes import Recover as Recover
from .apps.api.nodes import Sequence as Sequence
from .apps.api.nodes import SubTree as SubTree
from .files import PicktreeError as PicktreeError
from .robot.planning import PoseGoal as PoseGoal
from .trees import TreeDefinition as Tree

__all__ = [
    "Batch",
    "Cell",
    "Fallback",
    "ForEach",
    "Grasp",
    "Insert",
    "Mission",
    "Observe",
    "PicktreeError",
    "Place",
    "PoseGoal",
    "Push",
    "Recover",
    "Run",
    "Sequence",
    "SubTree",
    "Tree",
    "__version__",
    "batch",
    "load",
    "nodes",
    "run",
]

__version__: str
