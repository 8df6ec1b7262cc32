"""AskForHelp and SetAside: the operator decides how to continue, or an item is given up."""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, Final, cast

from picktree.robot import operator_desk
from picktree.trees import (
    ARM,
    In,
    Node,
    NodeStatus,
    Out,
    PortProblem,
    PortValues,
    Runtime,
    Wiring,
    control_flow,
    port,
    references,
)
from picktree.world import Failure, ObjectId, control, event_types, place, tree, world_facts

if TYPE_CHECKING:
    from picktree.robot import World

_INSERTED: Final = re.compile(r"\{@?[A-Za-z_]\w{0,59}(?:\.[A-Za-z_]\w{0,59}){0,9}\}", re.ASCII)


class AskForHelp(Node):
    """Brake and ask the operator for a decision. Reason and choices are shown; the answer is an output.

    Simulated time is frozen until the answer. Without a terminal, and in batches, the run ends `paused`;
    `picktree run --resume` asks again, or takes the answer from `--answer`. With the answer `give_up` the
    node fails with tree.given_up. In `reason` a reference such as {item.kind} is replaced by its value. The
    answer itself changes nothing: the nodes after this one act on it.
    """

    flow = control_flow.LeafFlow()
    example = """
    Sequence:
      - AskForHelp: {reason: "the {item.kind} slips each time", object: "{item}", answer: "{answer}"}
      - Switch:
          variable: "{answer}"
          cases:
            set aside: {SetAside: {object: "{item}"}}
          default: AlwaysSuccess
    """

    kind = "action"
    reason: In[str] = port(
        "reason for the request, as a sentence for a person; references in it are filled in", takes="template"
    )
    object: In[ObjectId] = port("the object in question, for the record", default=ObjectId(""))
    choices: In[list[str]] = port(
        "the answers to choose from",
        default=[operator_desk.GO_ON, operator_desk.SET_ASIDE, operator_desk.GIVE_UP],
    )
    give_up: In[str] = port("the choice with which the node fails", default=operator_desk.GIVE_UP)
    answer: Out[str] = port("the chosen answer")
    causes = (tree.GIVEN_UP, control.ANY)
    uses = (ARM,)
    remembers = ("_asks",)
    _asks: bool = False
    """Whether the arm is at rest and the question was asked."""

    def bind(self, wiring: Wiring, runtime: Runtime) -> None:
        super().bind(wiring, runtime)
        self._braking: Generator[None, None, None] | None = None

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        choices = given.constants.get("choices")
        if not isinstance(choices, list):
            return ()
        named = [" ".join(choice.split()).casefold() for choice in cast("list[str]", choices)]
        if not named or not all(named):
            return (
                PortProblem("choices", "a person needs at least one answer to choose, and none is empty"),
            )
        twice = next((choice for choice in named if named.count(choice) > 1), None)
        return () if twice is None else (PortProblem("choices", f"{twice!r} is there twice"),)

    @property
    def saveable(self) -> bool:
        return self._asks

    def on_start(self) -> None:
        self._asks, self._braking = False, None

    def on_tick(self) -> NodeStatus:
        world = cast("World", self.world)
        if not self._asks:
            if not self._at_rest(world):
                return NodeStatus.RUNNING
            self._asks = True
        if not world.operator.waits(self.path):
            self._ask(world)
            return NodeStatus.RUNNING
        answer = world.operator.take(self.path)
        if answer is None:
            return NodeStatus.RUNNING
        self.feedback_message = f"the answer is: {answer}"
        self.answer = answer
        if answer == self.give_up:
            raise Failure(
                tree.GIVEN_UP, f"help was asked for, and given up: {self._text()}", object=self.object
            )
        return NodeStatus.SUCCESS

    def on_halt(self) -> None:
        self._braking = None
        cast("World", self.world).operator.withdraw(self.path)

    def _at_rest(self, world: World) -> bool:
        if self._braking is None:
            self._braking = world.move.rest()
        try:
            next(self._braking)
        except StopIteration:
            return True
        return False

    def _ask(self, world: World) -> None:
        question = operator_desk.OperatorQuestion(
            self.path, self._text(), tuple(self.choices), str(self.object), _situation(world)
        )
        world.operator.ask(question)
        self.feedback_message = f"waits for an answer: {question.reason}"
        world.journal.note(
            event_types.HelpWantedEvent(
                f"help is wanted: {question.reason}",
                self.path,
                reason=question.reason,
                choices=question.choices,
                object=question.object,
                situation=question.situation,
            )
        )

    def _text(self) -> str:
        """Return the reason with its references replaced by values. Raises Failure when one has no value."""
        return _INSERTED.sub(self._value, self.reason)

    def _value(self, found: re.Match[str]) -> str:
        reference = references.Reference.parse(found[0])
        assert reference is not None
        try:
            value = self.wiring.namespace.read(reference, self.world.scene)
        except KeyError:
            raise Failure(
                tree.MISSING_INPUT,
                f"in 'reason' of {self.wiring.id}: nothing has written {reference} yet",
                port="reason",
                reference=str(reference),
            ) from None
        return "nothing" if value is None else str(value)


_MAX_NAMED = 3
"""Maximum number of items that the situation names."""


def _situation(world: World) -> str:
    """Return the situation in the robot's belief, as one sentence for the operator."""
    held, to_do = world.scene.held, world.to_do()
    parts = ["the arm stands still"]
    stop = world.control.monitor.stopped
    if stop is not None:
        parts[0] += f", stopped by {stop.cause}"
    parts.append("the hand is empty" if held is None else f"{held.id} is in the hand")
    left = [o for o in to_do if held is None or o.id != held.id]
    if left:
        named = ", ".join(
            f"{o.id} at ({o.pose.position[0]:.2f}, {o.pose.position[1]:.2f}) m" for o in left[:_MAX_NAMED]
        )
        more = f" and {len(left) - _MAX_NAMED} more" if len(left) > _MAX_NAMED else ""
        parts.append(f"{len(left)} to be done: {named}{more}")
    else:
        parts.append("nothing else is to be done" if world.vision.observations else "nobody has looked yet")
    return f"{'; '.join(parts)}; {world.journal.items_done} done so far"


_GIVEN_UP_ENTRY = "given up"
"""Entry in the memory of attempts for each time that an item was given up."""


class SetAside(Node):
    """Give up an item where it lies: it is no longer among the items to be done, until it is put elsewhere.

    With `after: 2` the first call is only counted: the item may be within reach when others are out of its
    way. Nothing moves: the belief alone changes. SUCCESS when the item is gone.
    """

    flow = control_flow.LeafFlow(instant=True, gives_up=True)
    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - SetAside: {object: "{item}", after: 2}
    """

    kind = "action"
    played = False
    object: In[ObjectId] = port("the item to give up, which is not in the hand")
    after: In[int] = port(
        "number of the call that gives the item up; earlier calls are only counted", default=1, least=1
    )
    causes = (place.MISSED,)

    def on_tick(self) -> NodeStatus:
        world = cast("World", self.world)
        belief = world.scene.find(self.object)
        if belief is None:
            return NodeStatus.SUCCESS
        if belief.attached:
            raise Failure(
                place.MISSED, f"{self.object} is in the hand: let go of it first", object=self.object
            )
        world.attempts.failed(self.path, self.object, _GIVEN_UP_ENTRY)
        times = world.attempts.count(self.path, self.object)
        self.feedback_message = f"{self.object} was given up {times} of {self.after} times"
        if times < self.after:
            return NodeStatus.SUCCESS
        world.attempts.forget(self.object)
        world.scene.put(replace(belief, place=world_facts.ASIDE), "set aside: it is left where it lies")
        x, y, _ = belief.pose.position
        world.journal.note(
            event_types.SetAsideEvent(
                f"{self.object} is left where it lies",
                self.path,
                object=self.object,
                form=belief.form,
                x=x,
                y=y,
                times=times,
            )
        )
        return NodeStatus.SUCCESS
