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
    """Ticks its children in order until one fails; goes on with the child that was RUNNING.

    SUCCESS when all succeeded (skipped ones do not count), SKIPPED when all were skipped. It fails with the
    failure of its failing child."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SequenceWithMemory(Node):
    """A Sequence that goes on with the child that failed or was halted, also when it is started again.

    Children before that one are not ticked again until all have succeeded. SKIPPED when all were skipped in
    one go."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Fallback(Node):
    """Ticks its children in order until one succeeds; goes on with the child that was RUNNING.

    When none succeeds it fails with the last child's failure, the others' attached. A child without a report
    (a false condition) does not hide one that has. SKIPPED when all were skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ReactiveSequence(Node):
    """Asks every child anew at each tick, from the first: conditions first, then what they guard.

    When an earlier child runs or fails, a later one that was RUNNING is halted, after the earlier was ticked."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class ReactiveFallback(Node):
    """Tries every child anew at each tick, from the first.

    When an earlier child runs or succeeds, a later one that was RUNNING is halted, after the earlier was
    ticked. Both hold the arm for a moment, and the one that acquired it last keeps it."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class PipelineSequence(Node):
    """Ticks its children again at each tick, from the first to the furthest that has run, as Nav2's.

    A child that runs again does not hold up those behind it that have begun. It ends when a child fails, or
    when the last has succeeded; what still runs is then halted. SKIPPED when all were skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RoundRobin(Node):
    """Ticks its children in turn, and begins each time after the child that succeeded last, as Nav2's.

    A child that fails or is skipped passes the turn on, in the same tick. It fails when all have failed, and,
    unless it may `wrap_around`, when the last child has had its turn and did not succeed. Whose turn it is
    outlasts success; failure and being halted give it back to the first child. As handler of a `Recover` it
    tries another cure at each failure.

    Ports:
        wrap_around: after the last child it is the first one's turn again; default False.
    """

    def __init__(
        self,
        *children: Child,
        wrap_around: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AsyncSequence(Node):
    """A Sequence that can be halted between two children: the tick ends behind each that succeeds at once."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AsyncFallback(Node):
    """A Fallback that can be halted between two children: the tick ends behind each that fails at once."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class TryCatch(Node):
    """A Sequence of all children but the last, which runs when one of them fails: the node then fails, too.

    It fails with the failure of the child that failed, however the last child ends. With `catch_on_halt` a
    halt also ticks the last child, once; nothing that takes longer may stand there, and nothing that moves.

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

    A number below zero counts from the end: -1 is all children, -2 all but one. It fails with the first
    failure, the others' attached. What still runs when it ends is halted. SKIPPED when all were skipped.

    Ports:
        success_count: how many children must succeed; -1 for all, -2 for all but one; default -1.
        failure_count: how many failures are too many; -1 when all failed; default 1.
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
    """Ticks all children in each tick until every one has ended, whatever the others do.

    It then fails when `max_failures` children or more have failed: with the first failure, the others'
    attached. A skipped child needs no end; SKIPPED when all were skipped.

    Ports:
        max_failures: how many failures are too many; -1 when all failed, -2 when all but one; default 1.
    """

    def __init__(
        self,
        *children: Child,
        max_failures: int | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class IfThenElse(Node):
    """Asks its first child once; then ticks the second (yes) or the third (no) until it ends.

    Without a third child a no is FAILURE. SKIPPED when the condition is skipped."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WhileDoElse(Node):
    """Asks its first child at every tick, and ticks the second while it holds, the third while not.

    It is not a loop: it ends when the ticked child ends. As in BT.CPP the branch that is left is halted
    before the other is ticked. Without a third child a no is FAILURE."""

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
        variable: the value that decides; it is read at every tick.
        cases: what is done for each value
        default: what is done for all other values
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

    The tick ends between two elements. With `on_failure: continue` a failure is noted in the record as
    handled and the loop goes on; it then succeeds at the end. What it does not pass over: a fault of the
    program, and a safety stop that nobody has acknowledged. An empty list is SUCCESS; SKIPPED when the child
    was skipped for every element.

    Ports:
        in_: the elements.
        out: key of the present element, for the child to read. Output: the key to write, as '{out}'.
        on_failure: when the child fails: fail with it, or continue with the next element; default fail.
        most: how many elements at most, from the first; -1 for all; at least -1; default -1.
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
    """SUCCESS becomes FAILURE without a report, and FAILURE becomes SUCCESS, unless it is a safety stop."""

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

    `while` is asked before each cycle. The tick ends between two cycles. A skipped child skips the loop.

    Ports:
        num_cycles: how often; -1 for without end; at least -1; default -1.
        while_: go on only while this holds; asked before each cycle.
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
    """Runs its child again and again, one tick apart, until it fails; then it fails with its failure."""

    def __init__(
        self,
        *children: Child,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RetryUntilSuccessful(Node):
    """Runs its child until it succeeds, at most `num_attempts` times, one tick apart.

    When all attempts are used up it fails with the last failure, the earlier ones attached; with
    tree.attempts when the child gave no reason. A fault of the program is not tried again.

    Ports:
        num_attempts: how often the child may run; -1 for without end; at least -1.
    """

    def __init__(
        self,
        *children: Child,
        num_attempts: int | str,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Timeout(Node):
    """Halts its child and fails with tree.timeout when it still runs after that time. 0 is without limit.

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
    """Waits that time, RUNNING, and then ticks its child.

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
    """Begins a round of its child at most `hz` times a second, as Nav2's; RUNNING in between.

    The first round begins at once, the next when that time has passed since the last success. A child that
    runs is ticked at each tick. It is made for the children of a PipelineSequence: a parent that resets it
    after its end begins the next round at once.

    Ports:
        hz: rounds a second; more than 0; default 10.0.
    """

    def __init__(
        self,
        *children: Child,
        hz: float | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class RunOnce(Node):
    """Runs its child until it has ended once; after that it is SKIPPED, or answers as the child did then.

    Ports:
        then_skip: after the first time SKIPPED (true), or the first answer again (false); default True.
    """

    def __init__(
        self,
        *children: Child,
        then_skip: bool | str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class SkipUnlessUpdated(Node):
    """Ticks its child when the key was written since the last time; otherwise it is SKIPPED.

    A child that runs is ticked until it ends. A write of an equal value counts, too.

    Ports:
        entry: the key whose writes count.
    """

    def __init__(
        self,
        *children: Child,
        entry: object,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class WaitValueUpdate(Node):
    """Ticks its child when the key was written since the last time; until then it is RUNNING.

    A child that runs is ticked until it ends. A write of an equal value counts, too.

    Ports:
        entry: the key whose writes count.
    """

    def __init__(
        self,
        *children: Child,
        entry: object,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AlwaysSuccess(Node):
    """SUCCESS at once."""

    def __init__(
        self,
        *,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class AlwaysFailure(Node):
    """FAILURE at once, without a report, as a false condition."""

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
        entry: the key whose writes count.
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
        value: the value, or a reference to another.
        output_key: the key to write it to. Output: the key to write, as '{output_key}'.
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
    """Assigns to keys of the blackboard: `key := expression`, several with `;`.

    `:=` makes the key where there is none; `=`, `+=`, `-=`, `*=` and `/=` change one that is there.

    Ports:
        code: the assignments, as `n := 3; n += 1`.
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

    Ports:
        message: the sentence for the record.
        value: a value to log behind it.
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
    """Waits that long, RUNNING, and then succeeds. 0 succeeds at once.

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
    """Brake, and ask the operator how to go on: the reason and the choices are shown, the answer is an
    output.

    Simulated time is frozen until the answer. Without a terminal and in batches the run ends `paused`;
    `picktree run --resume` asks again, or takes the answer with `--answer`. With the answer `give_up` the
    node fails with tree.given_up. In `reason` a reference as {item.kind} is replaced by its value. The answer
    itself changes nothing: the nodes after this one act on it.

    Ports:
        reason: why help is needed: a sentence for a person; references in it are filled in.
        object: what it is about, for the record.
        choices: the answers to choose from; default ['go on', 'set aside', 'give up'].
        give_up: the choice with which the node fails; default give up.
        answer: the choice that was made. Output: the key to write, as '{answer}'.
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

    The first pattern of `when` that matches the cause is used, in the order of the file, else `otherwise`.
    A cause without a handler fails at once. A handler that fails ends the node with the original cause, the
    handler's attached. When all attempts are used up, `give_up` is run: it leaves the arm in a state from
    which others can go on. So it is when nothing has changed since an earlier try (evidence `unchanged`) and
    two handlers did not help, or the first try of this run fails so; and when an object is unknown after what
    is tried against that. The node then fails with the last cause, the earlier ones attached. A fault of the
    program is handled only where a pattern names it: `internal.error`.

    A handler of `instead` takes the place of `do`: it comes before those of `when`, after the last attempt,
    too, and with its success the node succeeds. So an item that is no good is done when it is in quarantine.
    The outputs give `do`, the handlers and `give_up` the number of the attempt and the handled failure. The
    tick ends between a handler and the next attempt.

    Ports:
        attempts: how often `do` may run; at least 1; default 3.
        attempt: number of the attempt that runs, or failed last: 1, 2, …. Output: the key to write, as '{attempt}'.
        cause: cause of the failure that is being handled; empty before the first. Output: the key to write, as '{cause}'.
        message: its sentence. Output: the key to write, as '{message}'.
        failed: path of the node that it comes from. Output: the key to write, as '{failed}'.
        when: cause, or family of causes, and what may cure it
        otherwise: what may cure all other causes
        instead: cause, or family of causes, and what is done in place of `do`, which is not tried again
        give_up: what is done before failing for good
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
    """Runs its first child; when it fails, runs the second, then the first again, as Nav2's.

    The first child runs once more than `number_of_retries`. When the second child fails or is skipped, the
    node fails with the first one's cause, the second one's attached. When all retries are used up, it fails
    with the last cause, the earlier ones attached. SKIPPED when the first child is. The tick ends between the
    two. `Recover` chooses the handler by the cause.

    Ports:
        number_of_retries: how often the second child may run; at least 0; default 1.
        attempt: number of the attempt that runs, or failed last: 1, 2, …. Output: the key to write, as '{attempt}'.
        cause: cause of the failure that is being handled; empty before the first. Output: the key to write, as '{cause}'.
        message: its sentence. Output: the key to write, as '{message}'.
        failed: path of the node that it comes from. Output: the key to write, as '{failed}'.
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
    time is over is finished; the next is refused. The nodes below then give up, with their `give_up`. The
    budget fails with tree.budget, with the failure that was not handled attached. Without recovery the child
    may run without limit.

    With `of` each object has an account, which is kept until the child succeeds with that object. Without
    `of` each start of the node opens a new account. Budgets may be nested: a recovery is charged to all of
    them.

    Ports:
        of: the object whose account this is, kept between two runs; without it, an account for each run.
        tries: how many handlers may run; -1 for any number; at least -1; default -1.
        time: how long recovery may take; 0 for any time, s; at least 0; default 0.0.
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
    """Take the value that a list has for this attempt: the first for the first; after the last, the last.

    So an attempt is made with more force, more slowly, through another camera than the one before. Numbers
    are in SI units, without unit.

    Ports:
        attempt: which attempt it is: 1, 2, …; output `attempt` of the Recover; at least 1.
        values: one for each attempt.
        value: the one for this attempt. Output: the key to write, as '{value}'.
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
    """While its child runs, motions are planned with other seed, budget, clearance or planner.

    It holds for what the child itself plans, and only in its own ticks: however the child ends, everything is
    planned as before afterwards. Where one stands in the other, budgets multiply, clearances add up, and the
    inner seed and planner count.

    Ports:
        seed: another number, other random trees; 0 for the usual ones; at least 0; default 0.
        budget: how many times the collision checks that a plan may take otherwise; more than 0, at most 100; default 1.0.
        clearance: how much more room free motions keep than the usual margins, m; at least 0, at most 0.1; default 0.0.
        planner: the planner of free motions, as `bit_star`; the usual one unless given.
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
        of: causes, or families as `grasp.*`.
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
    """Whether another look may help: something is not where it was believed to be, or was not seen well.

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
    """Whether getting clear may help: a safety stop waits to be acknowledged, or the arm stands too near.

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
    """Whether to take hold of the object elsewhere, or anew, may help.

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
    """Whether opening and closing the empty fingers may help: they did not do what they were told to.

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
    """Whether planning otherwise may help: with another seed, with more checks, with more room.

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
    """Whether pushing the object free may help: the hand does not fit around it where it lies.

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
    """Whether time alone may help: a sensor, a camera or the arm may come to itself, what rolls may lie.

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

    The nearest one to where the hand is, within reach, away from edges, bins and everything believed; after
    it was offered once, another one. `Place` with `at` puts the object there.

    Ports:
        object: what the hand holds.
        at: the place of its underside: x, y, z in the world, m. Output: the key to write, as '{at}'.
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

    First through those that hang still, from where the arm is; then from each pose, through all. With
    `expect` it ends as soon as that object was seen; without it, when every camera has looked once. A camera
    that gives no picture, or a pose that cannot be reached, is passed over while another is left.

    Ports:
        expect: what is looked for; without it, all cameras look once.
        objects: ids of the items that do not lie where they belong, in the order to take them. Output: the key to write, as '{objects}'.
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
    """Open the fingers, close them, open them again, and measure each time whether they did.

    For a gripper that did not do what it was told to. Between two tries it waits, since what jams may come
    free by itself. The hand must be empty; with `drop` what is held is let go first, where the hand is.

    Ports:
        drop: whether to let go first of what the hand holds, where it is; default False.
        tries: how often the fingers are moved to and fro; at least 1, at most 20; default 3.
        wait: time between two tries, s; at least 0; default 2.0.
        force: with which each finger closes, N; more than 0; default 10.0.
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
    direction. When there is no safe way it fails with what was tried, and stays where it is.

    Ports:
        pose: named pose of the robot to end in; default home.
        hand: a held object: keep it, open the hand and drop it where it is, or put it down on a free spot below on the way; default keep.
        speed: share of the joints' speed limits: 1 for as fast as allowed; nothing goes faster than 0.25 m/s; more than 0, at most 1; default 0.4.
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
    """Give an item up where it lies: it is among the items to be done no longer, until it is put elsewhere.

    With `after: 2` the first time only counts, for the item may be had when others are out of its way.
    Nothing moves: the belief alone changes. An item that is gone needs no giving up: SUCCESS.

    Ports:
        object: the item to give up, which is not in the hand.
        after: which time it is given up indeed; before that it is counted; at least 1; default 1.
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

    What the hand holds comes first: nothing else can be grasped before. The others follow in an order that
    keeps the travel of the empty hand short.

    Ports:
        camera: the camera to look through; default overhead.
        expect: fail when this object is not in view; without it, whatever is seen will do.
        objects: ids of the items that do not lie where they belong, in the order to take them. Output: the key to write, as '{objects}'.
    """

    def __init__(
        self,
        *,
        camera: str = ...,
        expect: str = ...,
        objects: str = ...,
        name: str = ...,
        **conditions: Unpack[Conditions],
    ) -> None: ...

class Grasp(Node):
    """Grasp an object between the fingers from above and lift it clear.

    Candidates are grasps with the places that they lead to, ranked. A candidate counts only if the hand fits
    between the neighbours and the arm reaches it. From there the arm must also be able to put the object
    where it belongs. Where the hand does not fit upright, as beside a wall, it leans. The fingers close until
    contact, and the hand gives way to the one that touches first. Finger opening and load on the wrist show
    whether the object is held; an object that slips is gripped more firmly. An object that was missed or lost
    is grasped once more, if it is seen from there or was lost where it was gripped.

    Ports:
        object: the object to grasp.
        force: greatest grip force of each finger: it presses as weight and friction need, but never harder than this, than the item bears (`force_limit`) or than the gripper can, N; more than 0; default 70.0.
        speed: share of the joints' speed limits: 1 for as fast as allowed; more than 0, at most 1; default 1.0.
        onward: whether the object is carried on towards where it belongs, for a `Place` that follows at once: lift and transfer are one motion then; the arm stops by itself when none does; default True.
        servo: whether the hand stops over the object and corrects its way by what the camera on it sees, where there is one; default True.
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

    The camera maps the heights of what lies there. The hand's shape is swept over the map: vertical
    grasps come first, then tilted ones, then looser demands. What the wrist feels after the lift tells
    whether something is held. The thing is then an object of the belief with its hull, colour and weight, for
    `Place`. A thing that the hand holds already is kept. A place where a grasp has failed is left out until
    the depth there changes.

    Ports:
        from_: the tote, or the fixture with a pile, to pick from.
        out: id of the thing in the hand. Output: the key to write, as '{out}'.
        camera: the camera that sees the heap; default overhead.
        force: grip force of each finger at most, N; more than 0; default 30.0.
        attempts: grasps that are tried, with a look before each; at least 1; default 3.
        speed: share of the joints' speed limits: 1 for as fast as allowed; more than 0, at most 1; default 1.0.
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
    with `grasp.double`, and the hand still holds them. What is learnt is kept for a thing that nobody has
    catalogued; an object of a known kind is only looked at.

    Ports:
        object: the object to present, which the hand holds.
        camera: the fixed camera to hold it before; default overhead.
        looks: looks at most: 2 for both sides of the hand; at least 1, at most 2; default 2.
        until_classified: whether it ends as soon as the scene's `destinations` know what they ask for; at once when they do already; default False.
        speed: share of the joints' speed limits: 1 for as fast as allowed; more than 0, at most 1; default 0.5.
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

    The hold is felt again before the release, and that the hand is empty after it. What is placed into a tote
    with a heap is a part of the heap again, and does not count as done.

    Ports:
        object: the object to place, which the hand holds.
        into: the bin to place it into; not needed with `at`.
        at: where its underside is put down, instead of `into`: x, y, z in the world, m.
        speed: share of the joints' speed limits: 1 for as fast as allowed; more than 0, at most 1; default 1.0.
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
        into: the hole, or the fixture of whose free holes it takes the closest fit; by default where the object belongs.
        search: how the mouth is searched: `tilt`, with the object leaning and one point of it first, after it a spiral; `spiral`, upright over the surface; `none`: straight down; default tilt.
        force: presses the object into the hole, N; more than 0, at most 40; default 15.0.
        press: presses the object onto the surface while searching, N; more than 0, at most 25; default 8.0.
        grip: of each finger while inserting; never more than the object bears, N; more than 0; default 30.0.
        depth: how deep the object is to go; 0 for down to the bottom, m; at least 0; default 0.0.
        pitch: between two turns of the spiral, m; more than 0; default 0.001.
        attempts: how often a search may begin anew, each time otherwise; at least 1, at most 10; default 3.
        speed: share of the joints' speed limits on the way there: 1 for as fast as allowed; more than 0, at most 1; default 1.0.
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

    The closed fingers push at a flat side, the opened ones hold what is round between them. After each stroke
    the arm goes out of the view and looks; the next stroke begins from what is seen and felt. What is pushed
    stays away from the edge of its table, and from everything else; to make room, what stands around is
    pushed along.

    Ports:
        object: the object to push, or to make room around; with `singulate` and without it the one that stands closest to others, and what nobody has recognised first.
        to: where its middle is to be: x, y in the world, m.
        yaw: its heading there, as seen from above, of what looks the same the nearest one; any unless given, rad.
        direction: of a push along a line: x, y in the world, of any length.
        distance: of a push along a line, m; at least 0, at most 1; default 0.0.
        singulate: push it, or what stands around it, until the hand fits around it; nothing is pushed when it does; default False.
        tolerance: how far off its middle may be in the end, m; more than 0; default 0.0015.
        turned: how far off its heading may be in the end, rad; more than 0; default 0.026179938779914945.
        strokes: how many strokes it may take; at least 1, at most 50; default 8.
        speed: of the tool while it pushes, m/s; more than 0, at most 0.2; default 0.05.
        force: of the object on the tool that stops a stroke, N; more than 0; default 15.0.
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
    """Push through the heap in a tote with closed or open fingers, for when nothing in it can be grasped.

    The strokes are planned from the height map. What lies against a wall is pushed off it; otherwise a stroke
    goes through the highest part. After each the arm moves out of the view and looks. A stroke that changed
    nothing is not repeated. Grasps that failed where the depth has changed may be tried again.

    Ports:
        in_: the tote to stir in.
        camera: the camera that sees into the tote; default overhead.
        strokes: strokes that are tried until things lie elsewhere; at least 1, at most 20; default 4.
        speed: of the tool while it pushes, m/s; more than 0, at most 0.2; default 0.08.
        force: of the things on the tool that stops a stroke, N; more than 0; default 15.0.
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

    What is seen to come into its way meanwhile stops it, and it plans anew.

    Ports:
        pose: named pose of the robot; default home.
        speed: share of the joints' speed limits: 1 for as fast as allowed; more than 0, at most 1; default 1.0.
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
    """Open the fingers; what they held is believed to be gone from the hand.

    Ports:
        width: opening between the fingers; 0 for as wide as they go, m; at least 0; default 0.0.
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
    """Tell the feed that the robot is ready for more, and wait until something has come.

    SUCCESS when something was set down since the robot last looked or waited, or when the feed is exhausted:
    the fact `feed_exhausted` tells which. What came, and where it lies, only a camera says: observe next. The
    arm must be out of the feed's way, for nothing is set down below it, and no belt runs there. What is
    believed on a belt is forgotten, for it rides on.

    Ports:
        longest: how long it waits at most, s; more than 0; default 120.0.
        clearance: how long the feed may wait for the arm to leave before it fails, s; at least 0; default 5.0.
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
    """Ask for an empty bin in a full one's place, and wait until it stands there. A tote into which the feed
    of the scene pours comes back full, until all has come.

    With `fill` it asks only for a bin whose heap, as seen, is at least so high, and succeeds at once for
    another. What was believed to lie in the bin goes with it. The arm must be clear of the bin, also with an
    item in the hand: nobody reaches below it.

    Ports:
        bin: the bin that is to be exchanged.
        fill: ask only when the heap is so high, as a share of the bin's depth; 0 for always; at least 0, at most 1; default 0.0.
        longest: how long it waits at most, s; more than 0; default 120.0.
        clearance: how long somebody may wait for the arm to leave before it fails, s; at least 0; default 5.0.
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
        velocity: of the tool's centre point along x, y, z, m/s; default [0.0, 0.0, 0.0].
        turn: of the tool about x, y, z, rad/s; default [0.0, 0.0, 0.0].
        frame: whose axes these are; default world.
        duration: how long; 0 for as long as nothing stops it, s; at least 0; default 0.0.
        distance: how far; 0 for as far as nothing stops it, m; at least 0; default 0.0.
        guard: contact force that stops it, N; more than 0; default 25.0.
        when_stopped: what it comes to when something stops it before time and distance are over; default fail.
        stopped_by: `done`, `contact`, `collision`, `joint_limit`, `singularity` or `workspace`. Output: the key to write, as '{stopped_by}'.
        travelled: way of the tool's centre point, m. Output: the key to write, as '{travelled}'.
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

    A camera on the hand is taken to places all around it, which differ as much in their turn as the arm
    allows. Places out of reach are passed over. Before a fixed camera the arm gets out of the way, and many
    pictures are averaged. Nothing is corrected yet: `picktree calibrate` does that.

    Ports:
        target: the fixture with `marker`; default target.
        camera: the camera to look through; default wrist.
        views: places to look from, of a camera on the hand; at least 4, at most 100; default 12.
        pictures: how many to average, of a camera that hangs still; at least 1, at most 1000; default 50.
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

    Each touch is recorded: where the tool was by the encoders, and the force. What is out of reach is passed
    over. Nothing is corrected yet: `picktree calibrate` finds out from it where the tool's centre point is,
    and where the target stands.

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

    The belief learns of each picture when the camera's time of thinking is over; the child does not wait for
    it. What the arm or what it holds hides stays believed. So a motion notices what comes into its way, and
    `Grasp` that its object was moved. While something is taken or let go, for 0.25 s after a grasp and 0.5 s
    after a release, no picture is taken.

    Ports:
        camera: the camera to look through; default overhead.
        every: time between two pictures, s; at least 0.05; default 0.5.
        blind: how long pictures may fail to come before the child is halted and the node fails with what the camera said, s; at least 0; default 2.0.
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
