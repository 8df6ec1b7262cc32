from .ask_for_help import AskForHelp as AskForHelp, SetAside as SetAside
from .free_spot import FreeSpot as FreeSpot
from .guards import (
    CauseIs as CauseIs,
    WouldAGripperResetHelp as WouldAGripperResetHelp,
    WouldARetreatHelp as WouldARetreatHelp,
    WouldAnotherGraspHelp as WouldAnotherGraspHelp,
    WouldLookingHelp as WouldLookingHelp,
    WouldPushingHelp as WouldPushingHelp,
    WouldReplanningHelp as WouldReplanningHelp,
    WouldWaitingHelp as WouldWaitingHelp,
)
from .look_around import LookAround as LookAround, ResetGripper as ResetGripper
from .nodes import NODES as NODES
from .recover import (
    Budget as Budget,
    ForAttempt as ForAttempt,
    PlanWith as PlanWith,
    Recover as Recover,
    RecoveryNode as RecoveryNode,
)
from .safe_retreat import SafeRetreat as SafeRetreat

# for other rooms
from .belief_restart import (
    ResyncReport as ResyncReport,
    last_look as last_look,
    resync_belief as resync_belief,
)
