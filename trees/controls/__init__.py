"""Control nodes, decorators and leaves of the language itself."""

from ..node import Node
from .branches import IfThenElse, Switch, WhileDoElse
from .decorator import Delay, ForceFailure, ForceSuccess, Inverter, RunOnce, Timeout
from .leaves import AlwaysFailure, AlwaysSuccess, Condition, Log, SetBlackboard
from .loops import ForEach, KeepRunningUntilFailure, Repeat, RetryUntilSuccessful
from .parallel import Parallel
from .sequence import Fallback, ReactiveFallback, ReactiveSequence, RoundRobin, Sequence

NODES: tuple[type[Node], ...] = (
    Sequence, Fallback, ReactiveSequence, ReactiveFallback, RoundRobin, Parallel,
    IfThenElse, WhileDoElse, Switch, ForEach,
    Inverter, ForceSuccess, ForceFailure, Repeat, KeepRunningUntilFailure, RetryUntilSuccessful,
    Timeout, Delay, RunOnce,
    AlwaysSuccess, AlwaysFailure, Condition, SetBlackboard, Log,
)  # fmt: skip
