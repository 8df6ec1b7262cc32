from .proof import prove as prove
from .resim import resimulate as resimulate
from .run import Run as Run
from .run_changes import RunChanges as RunChanges
from .whatif import what_if as what_if

# for other rooms
from .trials import outcomes as outcomes
