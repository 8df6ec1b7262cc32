"""Control nodes, decorators and leaves of the language itself."""

from ..node import Node
from .branches import IfThenElse, WhileDoElse
from .fallback import Fallback, ReactiveFallback
from .for_each import ForEach
from .force import ForceFailure, ForceSuccess, Inverter
from .leaves import AlwaysFailure, AlwaysSuccess, Condition, Log, SetBlackboard
from .parallel import Parallel
from .repeat import KeepRunningUntilFailure, Repeat
from .retry import RetryUntilSuccessful
from .round_robin import RoundRobin
from .run_once import RunOnce
from .sequence import ReactiveSequence, Sequence
from .switch import Switch
from .timing import Delay, Timeout

NODES: tuple[type[Node], ...] = (
    Sequence, Fallback, ReactiveSequence, ReactiveFallback, RoundRobin, Parallel,
    IfThenElse, WhileDoElse, Switch, ForEach,
    Inverter, ForceSuccess, ForceFailure, Repeat, KeepRunningUntilFailure, RetryUntilSuccessful,
    Timeout, Delay, RunOnce,
    AlwaysSuccess, AlwaysFailure, Condition, SetBlackboard, Log,
)  # fmt: skip
