# Written by `picktree nodes --stub`: the constructors of the nodes, with their ports.
from collections.abc import Iterable, Mapping
from os import PathLike
from types import ModuleType
from typing import Any, Literal, TypeAlias, TypedDict, Unpack

from picktree.trees import Node
from picktree.trees import TreeDefinition as Tree

Child: TypeAlias = Node | Iterable[Node]

class Conditions(TypedDict, total=False):
    _failureIf: str
    _successIf: str
    _skipIf: str
    _while: str
    _onHalted: str
    _onFailure: str
    _onSuccess: str
    _post: str
    breakpoint: str

class Sequence(Node):
    """Ticks its children in order until one fails; resumes at the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SequenceWithMemory(Node):
    """A Sequence that resumes at the child that failed or was halted, also after a new start.

    Children before that one are not ticked again until all have succeeded. SKIPPED when all were skipped in
    one activation."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Fallback(Node):
    """Ticks its children in order until one succeeds; resumes at the child that was RUNNING.

    When none succeeds, it fails with the last child's failure and attaches the failures of the others. A
    child without a report (a false condition) does not hide the report of another. SKIPPED when all were
    skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ReactiveSequence(Node):
    """Ticks every child again at each tick, from the first: conditions first, then the guarded child.

    When an earlier child runs or fails, a later child that was RUNNING is halted. The earlier child is ticked
    before this halt."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ReactiveFallback(Node):
    """Ticks every child again at each tick, from the first.

    When an earlier child runs or succeeds, a later child that was RUNNING is halted. The earlier child is
    ticked before this halt. So both hold the arm for a moment; the child that acquired it last keeps it."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class PipelineSequence(Node):
    """Ticks its children again at each tick, from the first to the furthest that has run, as in Nav2.

    A child that runs again does not delay later children that have begun. It ends when a child fails, or when
    the last child has succeeded; children that still run are then halted. SKIPPED when all were skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RoundRobin(Node):
    """Ticks its children in turn, and starts each time after the child that succeeded last, as in Nav2.

    After a child that fails or is skipped, the next child runs in the same tick. The node fails when all have
    failed. Without `wrap_around` it also fails when the last child has failed, and once after the last child
    has succeeded. After a failure or a halt of the node the first child is next. As handler of a `Recover`
    the node tries another cure at each failure.

    Ports:
        wrap_around: whether the first child follows the last one; default False.
    """

    def __init__(
        self,
        *children: Child,
        wrap_around: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AsyncSequence(Node):
    """A Sequence that ends the tick after a child that succeeds in its first tick; it can be halted there."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AsyncFallback(Node):
    """A Fallback that ends the tick after a child that fails in its first tick; it can be halted there."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class TryCatch(Node):
    """A Sequence of all children but the last; when one fails, the last child runs, and the node then fails.

    It fails with the failure of the child that failed, however the last child ends. With `catch_on_halt` a
    halt also ticks the last child, once; that child must end in one tick and move nothing.

    Ports:
        catch_on_halt: whether a halt ticks the last child, too; default False.
    """

    def __init__(
        self,
        *children: Child,
        catch_on_halt: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Parallel(Node):
    """Ticks all children that have not ended, in order, in each tick.

    A number below zero counts from the end: -1 is all children, -2 all but one. The node fails with the first
    failure and attaches the others. Children that still run at its end are halted. SKIPPED when all were
    skipped.

    Ports:
        success_count: number of children that must succeed; -1 for all, -2 for all but one; default -1.
        failure_count: number of failures at which the node fails; -1 for all children; default 1.
    """

    def __init__(
        self,
        *children: Child,
        success_count: int | str = ...,
        failure_count: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ParallelAll(Node):
    """Ticks all children in each tick until every one has ended, independent of the results of others.

    It then fails when `max_failures` children or more have failed. It fails with the first failure and
    attaches the others. A skipped child needs no end. SKIPPED when all were skipped.

    Ports:
        max_failures: number of failures at which the node fails; -1 for all children, -2 for all but one; default 1.
    """

    def __init__(
        self,
        *children: Child,
        max_failures: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class IfThenElse(Node):
    """Ticks its first child until it ends; then ticks the second after SUCCESS, the third after FAILURE.

    Without a third child, FAILURE of the first is FAILURE of the node. SKIPPED when the condition is skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WhileDoElse(Node):
    """Ticks its first child at every tick, then the second while the first succeeds, the third while it
    fails.

    It is not a loop: it ends when the ticked child ends. As in BT.CPP the branch that is left is halted
    before the other is ticked. Without a third child, FAILURE of the first is FAILURE of the node."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Switch(Node):
    """Ticks the case whose name is the value of `variable`, else `default`.

    The value is read at every tick; when it changes, the case that was RUNNING is halted before the other is
    ticked, as in BT.CPP. Without a case and a default it fails with tree.no_case.

    Ports:
        variable: the value to match; it is read at every tick.
        cases: child for each value
        default: child for all other values
    """

    def __init__(
        self,
        *,
        variable: object,
        cases: Mapping[str, Child],
        default: Child = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ForEach(Node):
    """Runs its child once for each element of a list, which is read when the loop starts.

    The tick ends between two elements. With `on_failure: continue` a failure is recorded as handled and the
    loop continues; it then succeeds at the end. It never passes over a fault of the program, nor a safety
    stop without acknowledgement. An empty list is SUCCESS; SKIPPED when the child was skipped for every
    element.

    Ports:
        in_: the elements.
        out: key of the present element, for the child to read. Output: the key to write, as '{out}'.
        on_failure: reaction to a failure of the child: fail with it, or continue with the next element; default fail.
        most: maximum number of elements, from the first; -1 for all; at least -1; default -1.
    """

    def __init__(
        self,
        *children: Child,
        in_: Iterable[object] | str,
        out: str = ...,
        on_failure: Literal['fail', 'continue'] | str = ...,
        most: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Inverter(Node):
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS.

    A safety stop (safety.*) and a fault of the program stay failures."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ForceSuccess(Node):
    """SUCCESS however the child ends. It cannot hide a safety stop (safety.*) or a fault of the program."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ForceFailure(Node):
    """FAILURE however the child ends, with the child's failure when it has one."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Repeat(Node):
    """Runs its child `num_cycles` times, or for as long as `while` holds; it fails when the child fails.

    `while` is evaluated before each cycle. The tick ends between two cycles. SKIPPED when the child is.

    Ports:
        num_cycles: number of cycles; -1 for no limit; at least -1; default -1.
        while_: condition to continue, checked before each cycle.
    """

    def __init__(
        self,
        *children: Child,
        num_cycles: int | str = ...,
        while_: str | bool | None = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class KeepRunningUntilFailure(Node):
    """Runs its child once a cycle until the child fails, and then fails with its failure.

    The tick ends between two cycles."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RetryUntilSuccessful(Node):
    """Runs its child until the child succeeds, at most `num_attempts` times.

    The tick ends between two attempts. When all attempts are used up, it fails with the last failure and
    attaches the earlier ones. When the child gave no reason, it fails with tree.attempts. A fault of the
    program is not tried again.

    Ports:
        num_attempts: maximum number of runs of the child; -1 for no limit; at least -1.
    """

    def __init__(
        self,
        *children: Child,
        num_attempts: int | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Timeout(Node):
    """Halts its child and fails with tree.timeout when the child still runs after `msec`. 0: no limit.

    Ports:
        msec: simulated time that the child may take; 0 for no limit, ms; at least 0.
    """

    def __init__(
        self,
        *children: Child,
        msec: float | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Delay(Node):
    """Is RUNNING for `delay_msec`, and then ticks its child.

    Ports:
        delay_msec: simulated time to wait before the child is ticked, ms; at least 0.
    """

    def __init__(
        self,
        *children: Child,
        delay_msec: float | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RateController(Node):
    """Starts its child at most `hz` times a second, as in Nav2; between two runs it is RUNNING.

    The first run starts immediately, the next when 1/`hz` seconds have passed since the last success. A child
    that runs is ticked at each tick. The node is made for the children of a PipelineSequence. With a parent
    that resets it after its end, the next run starts immediately.

    Ports:
        hz: maximum number of starts of the child per second; more than 0; default 10.0.
    """

    def __init__(
        self,
        *children: Child,
        hz: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RunOnce(Node):
    """Runs its child until the child has ended once; after that it is SKIPPED or repeats the result.

    Ports:
        then_skip: result of the second and later runs: SKIPPED (true), or the first result again (false); default True.
    """

    def __init__(
        self,
        *children: Child,
        then_skip: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SkipUnlessUpdated(Node):
    """Ticks its child when the key was written since the child last started; otherwise it is SKIPPED.

    A child that runs is ticked until it ends. A write of an equal value counts, too.

    Ports:
        entry: the key whose writes the node watches.
    """

    def __init__(
        self,
        *children: Child,
        entry: object,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WaitValueUpdate(Node):
    """Ticks its child when the key was written since the child last started; until then it is RUNNING.

    A child that runs is ticked until it ends. A write of an equal value counts, too.

    Ports:
        entry: the key whose writes the node watches.
    """

    def __init__(
        self,
        *children: Child,
        entry: object,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AlwaysSuccess(Node):
    """SUCCESS in its first tick."""

    def __init__(
        self,
        *,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AlwaysFailure(Node):
    """FAILURE in its first tick, without a report, as a false condition."""

    def __init__(
        self,
        *,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Condition(Node):
    """Whether an expression holds. It sees the blackboard's keys and the facts of the world.

    Ports:
        if_: the expression that must hold.
    """

    def __init__(
        self,
        *,
        if_: str | bool,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WasEntryUpdated(Node):
    """Whether the key was written since the node was ticked last. A write of an equal value counts, too.

    Ports:
        entry: the key whose writes the node watches.
    """

    def __init__(
        self,
        *,
        entry: object,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SetBlackboard(Node):
    """Writes a value to the blackboard.

    Ports:
        value: the value, or a reference to an entry.
        output_key: the key to write to. Output: the key to write, as '{output_key}'.
    """

    def __init__(
        self,
        *,
        value: object,
        output_key: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Script(Node):
    """Assigns to keys of the blackboard: `key := expression`, separated by `;`.

    `:=` creates a missing key; `=`, `+=`, `-=`, `*=` and `/=` change an existing one.

    Ports:
        code: the assignments, such as `n := 3; n += 1`.
    """

    def __init__(
        self,
        *,
        code: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Log(Node):
    """Writes a sentence, and a value if given, into the record.

    `picktree replay` and the report show it among the events; the summary of a run does not.

    Ports:
        message: the sentence for the record.
        value: a value of any type to log after it.
    """

    def __init__(
        self,
        *,
        message: str,
        value: object = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Sleep(Node):
    """Is RUNNING for `msec`, and then succeeds. With 0 it succeeds in its first tick.

    Ports:
        msec: simulated time to wait, ms; at least 0.
    """

    def __init__(
        self,
        *,
        msec: float | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AskForHelp(Node):
    """Brake and ask the operator for a decision. Reason and choices are shown; the answer is an output.

    Simulated time is frozen until the answer. Without a terminal, and in batches, the run ends `paused`;
    `picktree run --resume` asks again, or takes the answer from `--answer`. With the answer `give_up` the
    node fails with tree.given_up. In `reason` a reference such as {item.kind} is replaced by its value. The
    answer itself changes nothing: the nodes after this one act on it.

    Ports:
        reason: reason for the request, as a sentence for a person; references in it are filled in.
        object: the object in question, for the record.
        choices: the answers to choose from; default ['go on', 'set aside', 'give up'].
        give_up: the choice with which the node fails; default give up.
        answer: the chosen answer. Output: the key to write, as '{answer}'.
    """

    def __init__(
        self,
        *,
        reason: str,
        object: str = ...,
        choices: Iterable[str] | str = ...,
        give_up: str = ...,
        answer: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Recover(Node):
    """Runs `do`; when it fails, runs the handler of the cause, then `do` again, at most `attempts` times.

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`. A
    cause without a handler fails immediately. A failing handler ends the node with the original cause; the
    handler's cause is attached. When all attempts are used up, `give_up` is run: it leaves the arm in a state
    from which other nodes can continue. The node then fails with the last cause and attaches the earlier
    ones. Attempts also end early in two cases. The first: the last two failures, or the first one of this
    run, report an unchanged situation (evidence `unchanged`). The second: an object is still unknown after
    its handler. A fault of the program is handled only where a pattern names it: `internal.error`.

    A handler of `instead` replaces `do`. It takes precedence over those of `when`, also after the last
    attempt, and the node succeeds with it. So a defective item is done when it is in quarantine. The outputs
    give `do`, the handlers and `give_up` the number of the attempt and the handled failure. The tick ends
    between a handler and the next attempt.

    Ports:
        attempts: maximum number of runs of `do`; second tries within a skill, as of `Grasp`, do not count; at least 1; default 3.
        attempt: number of the present or last attempt: 1, 2, …. Output: the key to write, as '{attempt}'.
        cause: cause of the failure that is being handled; empty before the first. Output: the key to write, as '{cause}'.
        message: message of that failure. Output: the key to write, as '{message}'.
        failed: path of the node with that failure. Output: the key to write, as '{failed}'.
        when: cause, or family of causes, and its handler, which may cure the failure
        otherwise: handler of all other causes
        instead: cause, or family of causes, and the child that runs instead of `do`, which is not tried again
        give_up: child that runs before the node finally fails
    """

    def __init__(
        self,
        *children: Child,
        attempts: int | str = ...,
        attempt: str = ...,
        cause: str = ...,
        message: str = ...,
        failed: str = ...,
        when: Mapping[str, Child] = ...,
        otherwise: Child = ...,
        instead: Mapping[str, Child] = ...,
        give_up: Child = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RecoveryNode(Node):
    """Runs its first child; when it fails, runs the second, then the first again, as in Nav2.

    The first child runs at most `number_of_retries` + 1 times. When the second child fails or is skipped, the
    node fails with the first child's cause and attaches the second child's. When all retries are used up, it
    fails with the last cause and attaches the earlier ones. SKIPPED when the first child is. The tick ends
    between the two children. `Recover` chooses the handler by the cause.

    Ports:
        number_of_retries: maximum number of runs of the second child; at least 0; default 1.
        attempt: number of the present or last attempt: 1, 2, …. Output: the key to write, as '{attempt}'.
        cause: cause of the failure that is being handled; empty before the first. Output: the key to write, as '{cause}'.
        message: message of that failure. Output: the key to write, as '{message}'.
        failed: path of the node with that failure. Output: the key to write, as '{failed}'.
    """

    def __init__(
        self,
        *children: Child,
        number_of_retries: int | str = ...,
        attempt: str = ...,
        cause: str = ...,
        message: str = ...,
        failed: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Budget(Node):
    """Bounds the cost of recovery below: how many handlers may run, and how much time they may take.

    Each handler that a `Recover` or `RecoveryNode` below starts counts. The time from a first
    failure until it is cured or given up counts, too. A handler that runs when the
    time is used up may end; no further handler starts. The nodes below then give up, with their `give_up`.
    The budget fails with tree.budget and attaches the failure that was not handled. Without recovery the
    child may run without limit.

    With `of` each object has an account, which is kept until the child succeeds with that object. Without
    `of` each start of the node opens a new account. Budgets may be nested: a recovery is charged to all of
    them.

    Ports:
        of: the object of the account, which is kept between two runs; without it, each run has its own account.
        tries: maximum number of handlers; -1 for any number; at least -1; default -1.
        time: maximum simulated time for recovery; 0 for no limit, s; at least 0; default 0.0.
    """

    def __init__(
        self,
        *children: Child,
        of: str = ...,
        tries: int | str = ...,
        time: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ForAttempt(Node):
    """Take the value of a list for this attempt; attempts beyond the end of the list take the last value.

    So an attempt can use more force, less speed or another camera than the attempt before. Numbers are in SI
    units, without unit.

    Ports:
        attempt: number of the attempt: 1, 2, …; output `attempt` of the Recover; at least 1.
        values: values, one for each attempt.
        value: value for this attempt. Output: the key to write, as '{value}'.
    """

    def __init__(
        self,
        *,
        attempt: int | str,
        values: Iterable[object] | str,
        value: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class PlanWith(Node):
    """Plans motions of its child with another seed, budget, clearance or planner.

    The overrides apply only to plans of the child, in the child's ticks. They end with the child, whatever
    its result. For one `PlanWith` inside another, budgets multiply, clearances add up, and the inner seed and
    planner count.

    Ports:
        seed: seed of the random trees; 0 for the usual one; at least 0; default 0.
        budget: multiple of the usual number of collision checks of a plan; more than 0, at most 100; default 1.0.
        clearance: clearance of free motions beyond the usual margins, m; at least 0, at most 0.1; default 0.0.
        planner: planner of free motions, such as `bit_star`; by default the usual one.
    """

    def __init__(
        self,
        *children: Child,
        seed: int | str = ...,
        budget: float | str = ...,
        clearance: float | str = ...,
        planner: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class CauseIs(Node):
    """Whether the cause that is being handled is one of these, or of one of these families.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
        of: causes, or families such as `grasp.*`.
    """

    def __init__(
        self,
        *,
        cause: str,
        of: Iterable[str] | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldLookingHelp(Node):
    """Whether another look may help: an object was not at its believed place, or was not seen well.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldARetreatHelp(Node):
    """Whether a retreat may help: a safety stop waits to be acknowledged, or the arm is too near an
    obstacle.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldAnotherGraspHelp(Node):
    """Whether another grasp may help, at another place or after a new look.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldAGripperResetHelp(Node):
    """Whether a gripper reset may help: the empty fingers did not follow a command.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldReplanningHelp(Node):
    """Whether planning in another way may help: with another seed, more checks or more clearance.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldPushingHelp(Node):
    """Whether pushing the object free may help: the hand does not fit around it at its place.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WouldWaitingHelp(Node):
    """Whether waiting may help: a sensor, a camera or the arm may recover, and a rolling object may come to
    rest.

    Ports:
        cause: the cause that is being handled: output `cause` of the Recover.
    """

    def __init__(
        self,
        *,
        cause: str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class FreeSpot(Node):
    """Find a place on a table where the held object can be put down, with room for the hand around it.

    It is the free place nearest to the hand, within reach, and away from edges, bins and believed objects.
    The next start gives another place. `Place` with `at` puts the object there.

    Ports:
        object: the held object.
        at: place of the object's underside: x, y, z in the world, m. Output: the key to write, as '{at}'.
    """

    def __init__(
        self,
        *,
        object: str,
        at: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class LookAround(Node):
    """Look again in another way: through each camera of the scene, from each pose that robots look from.

    Fixed cameras look first, from the arm's present pose. Then the arm goes to each pose, and the cameras
    look there. With `expect` the node ends as soon as a camera has seen that object; without it, when every
    camera has looked once. A camera without a picture or a pose out of reach is skipped while another is
    left.

    Ports:
        expect: the object to look for; without it, all cameras look once.
        objects: ids of the items outside their destination, in the order in which to take them. Output: the key to write, as '{objects}'.
    """

    def __init__(
        self,
        *,
        expect: str = ...,
        objects: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ResetGripper(Node):
    """Open the fingers, close them, open them again, and measure the opening each time.

    For a gripper that did not follow a command. Between two tries it waits, since a jam may clear by itself.
    The hand must be empty; with `drop` it releases a held object first, at its present place.

    Ports:
        drop: whether a held object is released first, at its present place; default False.
        tries: number of times that the fingers close and open; at least 1, at most 20; default 3.
        wait: time between two tries, s; at least 0; default 2.0.
        force: grip force of each finger, N; more than 0; default 10.0.
    """

    def __init__(
        self,
        *,
        drop: bool | str = ...,
        tries: int | str = ...,
        wait: float | str = ...,
        force: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SafeRetreat(Node):
    """Brake, acknowledge a latched safety stop, stop pressing, get clear, then go to a safe pose.

    Where the arm is believed to be in contact, it moves slowly in the direction that reduces the depth
    fastest, the whole arm considered. It gives way to contact at any part of the arm, and tries another
    direction. Without a safe path it fails with the list of attempts, and the arm stays in place.

    Ports:
        pose: named pose of the robot to end in; default home.
        hand: treatment of a held object: keep it, open the hand and drop it here, or put it down on a free spot on the way to the pose; default keep.
        speed: share of the joints' speed limits: 1 for the full limits; no part moves faster than 0.25 m/s; more than 0, at most 1; default 0.4.
    """

    def __init__(
        self,
        *,
        pose: str = ...,
        hand: Literal['keep', 'open', 'put_down'] | str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SetAside(Node):
    """Give up an item where it lies: it is no longer among the items to be done, until it is put elsewhere.

    With `after: 2` the first call is only counted: the item may be within reach when others are out of its
    way. Nothing moves: the belief alone changes. SUCCESS when the item is gone.

    Ports:
        object: the item to give up, which is not in the hand.
        after: number of the call that gives the item up; earlier calls are only counted; at least 1; default 1.
    """

    def __init__(
        self,
        *,
        object: str,
        after: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Observe(Node):
    """Look through a camera; list the items that are to be taken somewhere.

    A held object comes first, since the hand can grasp nothing else before. The other items follow in an
    order that keeps the travel of the empty hand short.

    Ports:
        camera: the camera to look through; default overhead.
        expect: object that must be in view, else the node fails; without it, any view will do.
        fresh: whether everything in the image is recognised anew; otherwise objects without a change in the image are only confirmed; default False.
        objects: ids of the items outside their destination, in the order in which to take them. Output: the key to write, as '{objects}'.
    """

    def __init__(
        self,
        *,
        camera: str = ...,
        expect: str = ...,
        fresh: bool | str = ...,
        objects: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Grasp(Node):
    """Grasp an object between the fingers from above and lift it clear.

    Each candidate has a grasp and the place where the grasp leads; candidates are ranked. A candidate counts
    only if the hand fits between the neighbours and the arm reaches it. From there the arm must also be able
    to put the object where it belongs. Where the hand does not fit upright, as beside a wall, it leans. The
    fingers close until contact, and the hand gives way to the finger that touches first. Finger opening and
    load on the wrist show whether the object is held; an object that slips is gripped more firmly. An object
    that was missed or lost is grasped once more, if it is seen from there or was lost where it was gripped.

    Ports:
        object: the object to grasp.
        force: maximum grip force of each finger: the applied force follows from weight and friction, and is limited by this port, by the item (`force_limit`) and by the gripper, N; more than 0; default 70.0.
        speed: share of the joints' speed limits: 1 for the full limits; more than 0, at most 1; default 1.0.
        onward: whether lift and transfer to the destination are one motion, for a `Place` as the next skill; the arm stops by itself when no `Place` follows; default True.
        servo: whether the hand stops over the object and corrects the grasp by an image of the hand camera, if the robot has one; default True.
    """

    def __init__(
        self,
        *,
        object: str,
        force: float | str = ...,
        speed: float | str = ...,
        onward: bool | str = ...,
        servo: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class PickAny(Node):
    """Pick some thing out of a tote or a pile, without knowing its shape, size or weight.

    The camera maps the heights of the heap. The hand's shape is swept over the map: vertical grasps come
    first, then tilted ones, then grasps that meet looser demands. The weight at the wrist after the lift
    shows whether something is held. The thing then becomes an object of the belief with hull, colour and
    weight, for `Place`. A thing that the hand holds already is kept. A place where a grasp has failed is left
    out until the depth there changes.

    Ports:
        from_: the tote, or the fixture with a pile, to pick from.
        out: id of the thing in the hand. Output: the key to write, as '{out}'.
        camera: the camera that sees the heap; default overhead.
        force: maximum grip force of each finger, N; more than 0; default 30.0.
        attempts: maximum number of grasps, with a look before each; at least 1; default 3.
        speed: share of the joints' speed limits: 1 for the full limits; more than 0, at most 1; default 1.0.
    """

    def __init__(
        self,
        *,
        from_: str,
        out: str = ...,
        camera: str = ...,
        force: float | str = ...,
        attempts: int | str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Present(Node):
    """Hold the thing in the hand before a fixed camera, and learn its hull, colour, size and tag.

    The camera sees it from both sides of the hand, as far as the arm gets there. The pose follows from the
    camera's place and field of view; the fingers are beside the thing, so that they do not hide it. Two
    different tags, or surfaces of two colours, show that more than one thing is in the hand: the skill fails
    with `grasp.double`, and the hand still holds them. The result is stored only for a thing that is not in
    the catalogue; an object of a known kind is only looked at.

    Ports:
        object: the object to present, which the hand holds.
        camera: the fixed camera in front of which the hand holds the object; default overhead.
        looks: maximum number of looks: 2 for both sides of the hand; at least 1, at most 2; default 2.
        until_classified: whether the node ends as soon as the properties in the scene's `destinations` are known; it does not look when they are already known; default False.
        speed: share of the joints' speed limits: 1 for the full limits; more than 0, at most 1; default 0.5.
    """

    def __init__(
        self,
        *,
        object: str,
        camera: str = ...,
        looks: int | str = ...,
        until_classified: bool | str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Place(Node):
    """Place the held object into a bin, over the lowest part of its heap, or down at a point.

    The skill checks the hold before the release, and the empty hand after it. An object placed into a tote
    with a heap becomes part of the heap again and does not count as done.

    Ports:
        object: the object to place, which the hand holds.
        into: the bin to place it into; not needed with `at`.
        at: place of the object's underside, instead of `into`: x, y, z in the world, m.
        speed: share of the joints' speed limits: 1 for the full limits; more than 0, at most 1; default 1.0.
    """

    def __init__(
        self,
        *,
        object: str,
        into: str = ...,
        at: Iterable[float | str] | str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Insert(Node):
    """Put the held object into a hole or slot whose place is known roughly: touch, search, press, let go.

    The arm descends to contact, searches the mouth, presses with a wiggle down to the bottom, and lets go.
    Where the object gets stuck it is pulled back and pressed again, then drawn out and searched for with
    another pattern. When nothing helps, the skill ends with the object in the hand above the hole.

    Ports:
        object: the object to insert, which the hand holds.
        into: the hole, or a fixture, whose free hole with the closest fit is used; by default the destination of the object.
        search: search for the mouth: `tilt`, with a tilted object and one point of it first, then a spiral; `spiral`, upright over the surface; `none`, straight down; default tilt.
        force: force of the object into the hole, N; more than 0, at most 40; default 15.0.
        press: force of the object on the surface during the search, N; more than 0, at most 25; default 8.0.
        grip: grip force of each finger during the insertion; limited by `force_limit` of the item, N; more than 0; default 30.0.
        depth: depth of the insertion; 0 for down to the bottom, m; at least 0; default 0.0.
        pitch: distance between two turns of the spiral, m; more than 0; default 0.001.
        attempts: maximum number of searches, each with other parameters; at least 1, at most 10; default 3.
        speed: share of the joints' speed limits on the way to the hole: 1 for the full limits; more than 0, at most 1; default 1.0.
    """

    def __init__(
        self,
        *,
        object: str,
        into: str = ...,
        search: Literal['tilt', 'spiral', 'none'] | str = ...,
        force: float | str = ...,
        press: float | str = ...,
        grip: float | str = ...,
        depth: float | str = ...,
        pitch: float | str = ...,
        attempts: int | str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Push(Node):
    """Push an object over the table: to a place (`to`, `yaw`), along a line (`direction`, `distance`), or so
    that it can be grasped (`singulate`).

    The closed fingers push at a flat side; the opened ones hold a round object between them. After each
    stroke the arm leaves the view and the camera looks; the next stroke starts from the pose that image and
    contact gave. A pushed object keeps away from the edge of its table and from other bodies. With
    `singulate`, its neighbours may be pushed along.

    Ports:
        object: the object to push, or to make room around; by default, with `singulate`, the object closest to others, unrecognised objects first.
        to: goal of the object's middle: x, y in the world, m.
        yaw: goal of the object's heading, as seen from above; a symmetric object takes the nearest equal heading; by default any heading, rad.
        direction: direction of a push along a line: x, y in the world, of any length.
        distance: length of a push along a line, m; at least 0, at most 1; default 0.0.
        singulate: whether to push the object or its neighbours until the hand fits around the object; no push when the hand already fits; default False.
        tolerance: maximum distance of the object's middle from the goal, m; more than 0; default 0.0015.
        turned: maximum angle of the object's heading from the goal, rad; more than 0; default 0.026179938779914945.
        strokes: maximum number of strokes; at least 1, at most 50; default 8.
        speed: speed of the tool during a push, m/s; more than 0, at most 0.2; default 0.05.
        force: contact force on the tool that stops a stroke, N; more than 0; default 15.0.
        camera: the camera to look through; default overhead.
    """

    def __init__(
        self,
        *,
        object: str = ...,
        to: Iterable[float | str] | str = ...,
        yaw: float | str | None = ...,
        direction: Iterable[float | str] | str = ...,
        distance: float | str = ...,
        singulate: bool | str = ...,
        tolerance: float | str = ...,
        turned: float | str = ...,
        strokes: int | str = ...,
        speed: float | str = ...,
        force: float | str = ...,
        camera: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Stir(Node):
    """Push through the heap in a tote with closed or open fingers, when nothing in it can be grasped.

    The strokes are planned from the height map. Things against a wall are pushed away from it; otherwise a
    stroke goes through the highest part. After each stroke the arm moves out of the view, and the camera
    looks. A stroke that changed nothing is not repeated. Grasps that failed where the depth has changed may
    be tried again.

    Ports:
        in_: the tote to stir in.
        camera: the camera that sees into the tote; default overhead.
        strokes: maximum number of strokes until the heap has changed; at least 1, at most 20; default 4.
        speed: speed of the tool during a push, m/s; more than 0, at most 0.2; default 0.08.
        force: contact force on the tool that stops a stroke, N; more than 0; default 15.0.
    """

    def __init__(
        self,
        *,
        in_: str,
        camera: str = ...,
        strokes: int | str = ...,
        speed: float | str = ...,
        force: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class GoTo(Node):
    """Move the arm, free of collisions, to a named configuration of the robot file.

    When the camera shows a new obstacle in its path, the arm stops and replans.

    Ports:
        pose: named pose of the robot; default home.
        speed: share of the joints' speed limits: 1 for the full limits; more than 0, at most 1; default 1.0.
    """

    def __init__(
        self,
        *,
        pose: str = ...,
        speed: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class OpenGripper(Node):
    """Open the fingers; the belief then has no object in the hand.

    Ports:
        width: opening between the fingers; 0 for the full opening, m; at least 0; default 0.0.
    """

    def __init__(
        self,
        *,
        width: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class CloseGripper(Node):
    """Close the fingers with a force and report the opening at which they stopped.

    Ports:
        force: grip force of each finger, N; more than 0; default 30.0.
        width: opening at which the fingers stopped, m. Output: the key to write, as '{width}'.
    """

    def __init__(
        self,
        *,
        force: float | str = ...,
        width: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AwaitItems(Node):
    """Signal the feed that the robot is ready for more items, and wait for a delivery.

    SUCCESS when items were set down since the last look or wait, or when the feed is exhausted (fact
    `feed_exhausted`). Only a camera finds kind and place of new items: observe next. The arm must be out of
    the feed's way: nothing is set down below it, and no belt runs there. Objects on a belt are removed from
    the belief, since the belt moves them.

    Ports:
        longest: maximum waiting time, s; more than 0; default 120.0.
        clearance: maximum time that the feed waits for the arm to leave, before the node fails, s; at least 0; default 5.0.
    """

    def __init__(
        self,
        *,
        longest: float | str = ...,
        clearance: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ExchangeBin(Node):
    """Request an empty bin in place of a full one, and wait until it is there. A tote that the feed of the
    scene fills comes back full, as long as items are left.

    With `fill` it requests an exchange only for a bin whose heap, as seen, is at least that high; for any
    other bin it succeeds immediately. The content of the bin is removed from the belief. The arm must be
    clear of the bin, and so must a held item: bins are not exchanged below the arm.

    Ports:
        bin: the bin to exchange.
        fill: least height of the heap for an exchange, as a share of the bin's depth; 0 for any height; at least 0, at most 1; default 0.0.
        longest: maximum waiting time, s; more than 0; default 120.0.
        clearance: maximum time that the exchange waits for the arm to leave, before the node fails, s; at least 0; default 5.0.
    """

    def __init__(
        self,
        *,
        bin: str,
        fill: float | str = ...,
        longest: float | str = ...,
        clearance: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Jog(Node):
    """Move the tool with a velocity and turn it, for a time, a distance, or until something stops it.

    Nothing is planned. The arm slows down towards joint limits, singularities, the edge of the workspace and
    believed bodies, and stops before contact. A force above `guard` N stops it, too. With `when_stopped:
    succeed` a stop is a success, and `stopped_by` names its reason.

    Ports:
        velocity: velocity of the tool's centre point along x, y, z, m/s; default [0.0, 0.0, 0.0].
        turn: angular velocity of the tool about x, y, z, rad/s; default [0.0, 0.0, 0.0].
        frame: frame of these axes; default world.
        duration: duration of the jog; 0 for no limit, s; at least 0; default 0.0.
        distance: distance of the jog; 0 for no limit, m; at least 0; default 0.0.
        guard: contact force that stops the jog, N; more than 0; default 25.0.
        when_stopped: result when the jog is stopped before its time or distance is over; default fail.
        stopped_by: reason of the end: `done`, `contact`, `collision`, `joint_limit`, `singularity` or `workspace`. Output: the key to write, as '{stopped_by}'.
        travelled: path length of the tool's centre point, m. Output: the key to write, as '{travelled}'.
    """

    def __init__(
        self,
        *,
        velocity: Iterable[float | str] | str = ...,
        turn: Iterable[float | str] | str = ...,
        frame: Literal['world', 'tool'] | str = ...,
        duration: float | str = ...,
        distance: float | str = ...,
        guard: float | str = ...,
        when_stopped: Literal['fail', 'succeed'] | str = ...,
        stopped_by: str = ...,
        travelled: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Survey(Node):
    """Look at a calibration target, and record exactly where its squares are in the pictures.

    A camera on the hand takes pictures from all around the target, with rotations that differ as much as the
    arm allows. Viewpoints out of reach are skipped. A fixed camera takes many pictures while the arm is out
    of its view, and their mean is used. Nothing is corrected yet: `picktree calibrate` does that.

    Ports:
        target: the fixture with `marker`; default target.
        camera: the camera to look through; default wrist.
        views: number of viewpoints of a camera on the hand; at least 4, at most 100; default 12.
        pictures: number of images to average for a fixed camera; at least 1, at most 1000; default 50.
    """

    def __init__(
        self,
        *,
        target: str = ...,
        camera: str = ...,
        views: int | str = ...,
        pictures: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class TouchTarget(Node):
    """Touch the faces of a target with the tips of the closed fingers, upright, turned and leaning.

    Each touch is recorded with the tool's pose by the encoders and the force. Faces out of reach are skipped.
    The skill corrects nothing: `picktree calibrate` estimates the tool's centre point and the target's pose
    from the touches.

    Ports:
        target: the fixture with `marker`; default target.
    """

    def __init__(
        self,
        *,
        target: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WatchScene(Node):
    """Looks through a camera at intervals while its child runs, whether the arm moves or not.

    Each picture updates the belief when the camera's time of thinking is over; the child does not wait for
    it. Objects hidden by the arm or by the held object stay believed. So a motion detects a new obstacle in
    its path, and `Grasp` detects that its object was moved. No picture is taken during a grasp or a release,
    for 0.25 s after a grasp, and for 0.5 s after a release.

    Ports:
        camera: the camera to look through; default overhead.
        every: time between two pictures, s; at least 0.05; default 0.5.
        blind: maximum time without a picture; after it the child is halted, and the node fails with the camera's failure, s; at least 0; default 2.0.
    """

    def __init__(
        self,
        *children: Child,
        camera: str = ...,
        every: float | str = ...,
        blind: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SubTree(Node):
    """A call of a tree that was defined in Python, or (by its name) of a tree of an included file."""

    def __init__(self, tree: Tree, /, **ports: Any) -> None: ...

def plugin(file: str | PathLike[str]) -> ModuleType:
    """Return the module of a plug-in's file, whose nodes are its attributes."""
