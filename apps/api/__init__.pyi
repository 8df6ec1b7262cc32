from .batches import BatchResult as BatchResult, batch as batch
from .cell import Cell as Cell
from .mission import Mission as Mission, load as load
from .runs import MissionRun as MissionRun, run as run
