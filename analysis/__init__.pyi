from .cursor import Cursor as Cursor
from .run import Run as Run

# for other rooms
from .cursor import CursorChanges as CursorChanges, Edge as Edge
from .resim import resimulate as resimulate
from .run_changes import RunChanges as RunChanges
from .whatif import what_if as what_if
