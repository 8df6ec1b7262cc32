from . import nodes as nodes
from .api.batches import BatchResult as Batch
from .api.batches import batch as batch
from .api.cell import Cell as Cell
from .api.mission import Mission as Mission
from .api.mission import load as load
from .api.runs import MissionRun as Run
from .api.runs import run as run
from .errors import PicktreeError as PicktreeError
from .nodes import Fallback as Fallback
from .nodes import ForEach as ForEach
from .nodes import Grasp as Grasp
from .nodes import Insert as Insert
from .nodes import Observe as Observe
from .nodes import Place as Place
from .nodes import Push as Push
from .nodes import Recover as Recover
from .nodes import Sequence as Sequence
from .nodes import SubTree as SubTree
from .planning.requests import PoseGoal as PoseGoal
from .trees.tree_definition import TreeDefinition as Tree

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
