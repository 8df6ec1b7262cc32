from .cursor import Cursor as Cursor
from .resim import resimulate as resimulate
from .run import Run as Run
from .run_changes import RunChanges as RunChanges
from .whatif import what_if as what_if

# for other rooms
from .cursor import CursorChanges as CursorChanges, Edge as Edge
