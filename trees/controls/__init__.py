"""Control nodes, decorators and leaves of the language itself."""

from ..node import Node
from .branches import IfThenElse, Switch, WhileDoElse
from .decorator import Delay, ForceFailure, ForceSuccess, Inverter, RateController, RunOnce, Timeout
from .interruptible import AsyncFallback, AsyncSequence, TryCatch
from .leaves import AlwaysFailure, AlwaysSuccess, Condition, Log, Script, SetBlackboard, Sleep
from .loops import ForEach, KeepRunningUntilFailure, Repeat, RetryUntilSuccessful
from .parallel import Parallel, ParallelAll
from .sequence import (
    Fallback,
    PipelineSequence,
    ReactiveFallback,
    ReactiveSequence,
    RoundRobin,
    Sequence,
    SequenceWithMemory,
)
from .updates import SkipUnlessUpdated, WaitValueUpdate, WasEntryUpdated

NODES: tuple[type[Node], ...] = (
    Sequence, SequenceWithMemory, Fallback, ReactiveSequence, ReactiveFallback, PipelineSequence, RoundRobin,
    AsyncSequence, AsyncFallback, TryCatch,
    Parallel, ParallelAll,
    IfThenElse, WhileDoElse, Switch, ForEach,
    Inverter, ForceSuccess, ForceFailure, Repeat, KeepRunningUntilFailure, RetryUntilSuccessful,
    Timeout, Delay, RateController, RunOnce, SkipUnlessUpdated, WaitValueUpdate,
    AlwaysSuccess, AlwaysFailure, Condition, WasEntryUpdated, SetBlackboard, Script, Log, Sleep,
)  # fmt: skip
