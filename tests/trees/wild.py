"""Random small missions of leaves that do as they like, and a watch on what the analysis said of them.

`wild_mission` writes a mission from a seed, `Watched` analyses it, runs it, and holds every node's end against
what the analysis allows there: status, cause, written keys, what the hand holds.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from picktree.recovery.recover import Recover
from picktree.recovery.recovery_node import RecoveryNode
from picktree.trees.builder import build
from picktree.trees.condition import ConditionNode
from picktree.trees.controls.run_once import RunOnce
from picktree.trees.flow import State
from picktree.trees.flow.layout import Layout
from picktree.trees.flow.reasons import UNREPORTED
from picktree.trees.flow.state import EMPTY
from picktree.trees.flow.walk import Walk
from picktree.trees.loader import parse_mission
from picktree.trees.mission import Mission, NodeSpec
from picktree.trees.node import Control, Node
from picktree.trees.ports import In, Out, port
from picktree.trees.references import Constant, Reference
from picktree.trees.registry import Registry
from picktree.trees.runner import Tree
from picktree.trees.skill import ARM, Skill, Steps
from picktree.trees.slots import children
from picktree.trees.status import NodeStatus
from picktree.trees.subtree import SubTree
from picktree.world.causes import Failure, cause_named, control, grasp, safety
from picktree.world.facts import FACTS

from .scripted import FILE, TICK, FakeWorld

if TYPE_CHECKING:
    from picktree.world.world import World

CAUSES = ("grasp.missed", "grasp.slipped", "control.timeout", "safety.stop", "planning.no_path", "tree.timeout")
PATTERNS = ("grasp.*", "grasp.missed", "control.*", "safety.*", "tree.*", "tree.missing_input", "planning.*", "*")


@dataclass
class WildWorld(FakeWorld):
    """Its facts and leaves are drawn anew each time."""

    chance: random.Random = field(default_factory=random.Random)
    holds: str = ""
    """The path of the node that filled the hand."""

    def facts(self) -> Mapping[str, object]:
        drawn: dict[type, object] = {bool: self.chance.random() < 0.5, int: self.chance.randrange(3), str: ""}
        return {name: drawn.get(kind, self.clock.now) for name, kind in FACTS.items()}


class Do(Skill):
    """Runs for some ticks, writes at the end, and fails now and then, before or after it wrote."""

    value: In[object] = port("anything", default=None)
    out: Out[object] = port("a number")
    causes = (grasp.ANY, control.TIMEOUT)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        for _ in range(wild.chance.choice((0, 0, 0, 1, 2))):
            yield
        if wild.chance.random() < 0.3:
            self._fail(wild)
        self.out = wild.chance.randrange(3)
        if wild.chance.random() < 0.1:
            yield
            self._fail(wild)

    def _fail(self, wild: WildWorld) -> None:
        raise Failure(cause_named(wild.chance.choice(CAUSES[:3])), "as it likes")


class Stop(Skill):
    """Fails with a safety stop, as often as not."""

    causes = (safety.STOP,)

    def run(self, world: World) -> Steps:
        if cast("WildWorld", world).chance.random() < 0.5:
            yield
            raise Failure(safety.STOP, "as it likes")


class Hold(Skill):
    """Fills the hand; a failure may leave it full or as it was."""

    causes = (grasp.MISSED,)
    hand_after = "full"

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        yield from _wait(wild)
        if wild.chance.random() < 0.7:
            wild.holds = self.path
        yield from _wait(wild)
        if wild.chance.random() < 0.3:
            raise Failure(grasp.MISSED, "as it likes")
        wild.holds = self.path


class Drop(Skill):
    """Empties the hand, if it succeeds."""

    causes = (control.TIMEOUT,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        yield from _wait(wild)
        if wild.chance.random() < 0.3:
            raise Failure(control.TIMEOUT, "as it likes")
        wild.holds = ""


def _wait(wild: WildWorld) -> Iterator[None]:
    for _ in range(wild.chance.choice((0, 0, 1))):
        yield


class Whim(Node):
    """Any status at any tick."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        chance = cast("WildWorld", self.world).chance
        return chance.choice((NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING, NodeStatus.SKIPPED))


class Ask(ConditionNode):
    """Yes or no, whatever it is asked."""

    value: In[object] = port("anything", default=None)

    def answer(self, world: World) -> bool:
        return cast("WildWorld", world).chance.random() < 0.5


class Muddle(Control):
    """A control node of somebody else: ticks any of its children in any order, and ends as it likes."""

    parts = children("whatever")

    def on_tick(self) -> NodeStatus:
        chance = cast("WildWorld", self.world).chance
        running = [part for part in self.parts if part.state is NodeStatus.RUNNING]
        last = chance.choice(running or self.parts)
        state = last.step()
        if state is NodeStatus.RUNNING or chance.random() < 0.3:
            return NodeStatus.RUNNING
        state = chance.choice((state, NodeStatus.SUCCESS, NodeStatus.SKIPPED, NodeStatus.FAILURE))
        return self.fail_with(last.failure) if state is NodeStatus.FAILURE else state


NODES: tuple[type[Node], ...] = (Do, Stop, Hold, Drop, Whim, Ask, Muddle, Recover, RecoveryNode)


def registry() -> Registry:
    return Registry(NODES, installed=False)


# Writing a mission.

KEYS = ("a", "b", "c", "d")
LISTS = ("l", "m")
EXPRESSIONS = (
    "items_left", "not holding", "true", "false", "a == 1", "b != 2", "c > 0", "a == 1 or d == 2",
    "items_left and b == 0", "time > 0.1", "1 > 2", "items_to_do > 0", "a == 1 if holding else b == 1",
)  # fmt: skip
_Json = object


class Writer:
    """Writes trees of at most so many nodes."""

    def __init__(self, chance: random.Random, subtrees: Mapping[str, tuple[str, ...]]) -> None:
        self._chance = chance
        self._subtrees = subtrees
        self._left = chance.randrange(4, 16)
        self._controls: tuple[Callable[[int], _Json], ...] = (
            *(self._listed(name) for name in ("Sequence", "Sequence", "Fallback", "Fallback")),
            *(self._listed(name) for name in ("ReactiveSequence", "ReactiveFallback", "Muddle")),
            *(self._wrapped(name) for name in ("Inverter", "ForceSuccess", "ForceFailure")),
            self._wrapped("KeepRunningUntilFailure"),
            self._repeat, self._retry, self._timed, self._once, self._for_each, self._for_each,
            self._branches, self._branches, self._switch, self._parallel, self._parallel, self._turns,
            self._recover, self._recover, self._recovery_node,
        )  # fmt: skip

    def node(self, depth: int = 0) -> _Json:
        self._left -= 1
        write = self._leaf if depth > 4 or self._left <= 0 else self._any(self._controls + (self._leaf,) * 6)
        return self._conditioned(write(depth))

    def _any(self, choices: tuple[Callable[[int], _Json], ...]) -> Callable[[int], _Json]:
        return self._chance.choice(choices)

    def _with(self, share: float) -> bool:
        return self._chance.random() < share

    def _key(self) -> str:
        return "{%s}" % self._chance.choice(KEYS)

    def _leaf(self, _: int) -> _Json:
        if self._subtrees and self._with(0.2):
            return self._call()
        match self._chance.randrange(12):
            case 0 | 1:
                ports = {"value": self._key()} if self._with(0.4) else {}
                return {"Do": {**ports, **({"out": self._key()} if self._with(0.7) else {})}}
            case 2 | 3:
                return {"SetBlackboard": {"value": self._chance.choice((0, 1, self._key())), "output_key": self._key()}}
            case 4:
                return {"Log": {"message": "x", "value": self._key()}}
            case 5:
                return {"Condition": {"if": self._chance.choice(EXPRESSIONS)}}
            case 6:
                return {"Ask": {"value": self._key()} if self._with(0.5) else {}}
            case 7:
                return self._chance.choice(("Hold", "Drop", "Stop"))
            case 8:
                return self._chance.choice(("AlwaysSuccess", "AlwaysFailure"))
            case 9:
                return {"SetBlackboard": {"value": [1, 2], "output_key": "{%s}" % self._chance.choice(LISTS)}}
            case 10:
                return self._chance.choice(("Hold", "Drop"))
            case _:
                return "Whim"

    def _call(self) -> _Json:
        name = self._chance.choice(tuple(self._subtrees))
        ports: dict[str, _Json] = {}
        for port_ in self._subtrees[name]:
            if port_.startswith("in") or self._with(0.8):
                ports[port_] = self._key() if port_.startswith("out") or self._with(0.7) else 1
        return {name: ports}

    def _conditioned(self, node: _Json) -> _Json:
        if not self._with(0.15):
            return node
        identity, body = (node, {}) if isinstance(node, str) else next(iter(cast("dict[str, _Json]", node).items()))
        given = dict(cast("dict[str, _Json]", body)) if isinstance(body, dict) else {"do": body}
        for name in ("_skipIf", "_failureIf", "_successIf", "_while"):
            if self._with(0.25):
                given[name] = self._chance.choice(EXPRESSIONS)
        for name in ("_onSuccess", "_onFailure", "_post", "_onHalted"):
            if self._with(0.2):
                key, sign = self._chance.choice(KEYS), self._chance.choice((":=", ":=", "="))
                given[name] = f"{key} {sign} {self._chance.choice(('0', '1', 'b', 'c'))}"
        return {str(identity): given}

    def _children(self, depth: int, least: int = 1, most: int = 4) -> list[_Json]:
        return [self.node(depth + 1) for _ in range(self._chance.randint(least, most))]

    def _listed(self, name: str) -> Callable[[int], _Json]:
        return lambda depth: {name: self._children(depth)}

    def _wrapped(self, name: str) -> Callable[[int], _Json]:
        return lambda depth: {name: {"do": self.node(depth + 1)}}

    def _repeat(self, depth: int) -> _Json:
        ports: dict[str, _Json] = {}
        if self._with(0.6):
            ports["num_cycles"] = self._chance.choice((-1, 0, 1, 2, 3))
        if not ports or self._with(0.5):
            ports["while"] = self._chance.choice(EXPRESSIONS)
        return {"Repeat": {**ports, "do": self.node(depth + 1)}}

    def _retry(self, depth: int) -> _Json:
        attempts = self._chance.choice((-1, 0, 1, 2, 3))
        return {"RetryUntilSuccessful": {"num_attempts": attempts, "do": self.node(depth + 1)}}

    def _timed(self, depth: int) -> _Json:
        name, key = self._chance.choice((("Timeout", "msec"), ("Delay", "delay_msec")))
        return {name: {key: self._chance.choice((0, 50, 100, 200)), "do": self.node(depth + 1)}}

    def _once(self, depth: int) -> _Json:
        return {"RunOnce": {"then_skip": self._with(0.5), "do": self.node(depth + 1)}}

    def _for_each(self, depth: int) -> _Json:
        ports: dict[str, _Json] = {"in": self._chance.choice(([], [1], [1, 2], [0, 1, 2], "{l}", "{m}"))}
        if self._with(0.8):
            ports["out"] = self._key()
        if self._with(0.6):
            ports["on_failure"] = self._chance.choice(("continue", "fail"))
        if self._with(0.3):
            ports["most"] = self._chance.choice((-1, 0, 1, 2))
        return {"ForEach": {**ports, "do": self.node(depth + 1)}}

    def _branches(self, depth: int) -> _Json:
        return {self._chance.choice(("IfThenElse", "WhileDoElse")): self._children(depth, 2, 3)}

    def _switch(self, depth: int) -> _Json:
        cases = {str(value): self.node(depth + 1) for value in range(self._chance.randint(1, 2))}
        body: dict[str, _Json] = {"variable": self._chance.choice((0, 1, 2, self._key(), self._key())), "cases": cases}
        if self._with(0.5):
            body["default"] = self.node(depth + 1)
        return {"Switch": body}

    def _parallel(self, depth: int) -> _Json:
        parts = self._children(depth, 1, 4)
        ports: dict[str, _Json] = {}
        if self._with(0.5):
            ports["success_count"] = self._chance.choice((-1, -2, *range(1, len(parts) + 1)))
        if self._with(0.5):
            ports["failure_count"] = self._chance.choice((-1, *range(1, len(parts) + 1)))
        return {"Parallel": {**ports, "do": parts}}

    def _turns(self, depth: int) -> _Json:
        return {"RoundRobin": {"wrap_around": self._with(0.5), "do": self._children(depth)}}

    def _recover(self, depth: int) -> _Json:
        body: dict[str, _Json] = {"do": self.node(depth + 1)}
        if self._with(0.8):
            body["attempts"] = self._chance.randint(1, 4)
        patterns = self._chance.sample(PATTERNS, self._chance.randint(0, 3))
        if patterns:
            body["when"] = {pattern: self.node(depth + 1) for pattern in patterns}
        if not patterns or self._with(0.3):
            body["otherwise"] = self.node(depth + 1)
        if self._with(0.3):
            body["give_up"] = self.node(depth + 1)
        return {"Recover": body}

    def _recovery_node(self, depth: int) -> _Json:
        body = {"number_of_retries": self._chance.randint(0, 3), "do": self._children(depth, 2, 2)}
        return {"RecoveryNode": body}


def wild_mission(seed: int) -> str:
    """The text of a mission with up to three sub-trees, which may use those after them."""
    chance = random.Random(seed)
    trees: dict[str, _Json] = {}
    known: dict[str, tuple[str, ...]] = {}
    for index in range(chance.choice((0, 0, 1, 2, 3))):
        ports = chance.sample(("in_a", "in_b", "out_a", "out_b"), chance.randrange(4))
        # Inside, a port is one of the keys that every tree uses, so that it is read and written.
        named = {port_: f"{port_[:-1]}{chance.choice(KEYS)}" for port_ in ports}
        declared = {
            name: {"type": "any", "direction": name.split("_")[0]} for name in dict.fromkeys(named.values())
        }
        body = Writer(chance, dict(known)).node()
        name = f"Tree{index}"
        text = json.dumps(body)
        for key in declared:
            # An input must not be written: only what reads becomes a reader of the port.
            places = ('"value": ', '"variable": ') if key.startswith("in") else ('"value": ', '"out": ', '"output_key": ')
            for place in places:
                if chance.random() < 0.8:
                    text = text.replace(place + '"{%s}"' % key[-1], place + '"{%s}"' % key)
        trees[name] = {"ports": declared, **_with_all_written(json.loads(text), chance)}
        known[name] = tuple(declared)
    main = _with_all_written(Writer(chance, known).node(), chance)
    return json.dumps({"picktree": 1, "kind": "mission", "trees": {"Main": main, **trees}})


def _with_all_written(root: _Json, chance: random.Random) -> Mapping[str, _Json]:
    """The tree with a branch that writes all keys: one that nothing in its tree writes is refused."""
    writes = [{"SetBlackboard": {"value": 1, "output_key": "{%s}" % key}} for key in KEYS]
    writes += [{"SetBlackboard": {"value": [1], "output_key": "{%s}" % key}} for key in LISTS]
    branch = {"Sequence": chance.sample(writes, len(writes))}
    return {chance.choice(("Fallback", "Fallback", "Sequence", "Parallel", "RoundRobin")): [root, branch]}


# Watching it run.


class Unsound(AssertionError):
    """Something happened that the analysis had ruled out."""


class Watched:
    """A mission with what the analysis says of it."""

    def __init__(self, text: str) -> None:
        self.mission: Mission = parse_mission(text, FILE, registry())
        self.walk = Walk(self.mission)
        self.ends = self.walk.enter(self.mission.main)

    def run(self, seed: int, ticks: int = 30) -> NodeStatus:
        """Run it, all chances drawn from the seed. Raises Unsound."""
        world = WildWorld(chance=random.Random(seed))
        tree = build(self.mission, cast("World", world))
        watch = _Watch(self, tree, world)
        tree._runtime.end_hooks.append(watch.ended)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
        for _ in range(ticks):
            tree.tick()
            watch.after_tick()
            world.clock.now += TICK
            if tree.status is not NodeStatus.RUNNING:
                break
        return tree.status


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a node of the running tree stands in the text: its spec, and the instance of its tree."""

    spec: NodeSpec
    instance: SubTree
    tree: str


class _Watch:
    def __init__(self, watched: Watched, tree: Tree, world: WildWorld) -> None:
        self._watched, self._walk, self._tree, self._world = watched, watched.walk, tree, world
        self._places: dict[str, _Place] = {}
        self._callers: dict[str, _Place] = {}
        self._succeeded: set[str] = set()
        main = cast("SubTree", tree.root)
        self._locate(main.body, _Place(watched.mission.main.root, main, "Main"))

    def _locate(self, node: Node, place: _Place) -> None:
        self._places[node.path] = place
        if isinstance(node, SubTree):
            self._callers[node.path] = place
            root = self._watched.mission.trees[place.spec.id].root
            self._locate(node.body, _Place(root, node, place.spec.id))
            return
        for below, spec in zip(node.below, place.spec.children, strict=True):
            self._locate(below, _Place(spec, place.instance, place.tree))

    def after_tick(self) -> None:
        for node in self._tree.nodes:
            place = self._places.get(node.path)
            if place is not None and node.ticked and id(place.spec) not in self._walk.reached:
                raise Unsound(f"{node.path} is ticked: {self._walk.blocked.get(id(place.spec))}")

    def ended(self, path: str) -> None:
        place, node = self._places.get(path), self._tree.find(path)
        if place is None or node.state is NodeStatus.IDLE:
            return
        if node.failure is not None and node.failure.cause.name == "internal.error":
            raise Unsound(f"{path}: {node.failure.message}: {node.failure.evidence.get('traceback')}")
        if node.state is NodeStatus.SUCCESS:
            self._succeeded.add(path)
        bits = self._bits(place.instance, place.tree)
        hand = self._hand()
        status, cause = node.state, self._cause(node)
        if not any(self._allows(end, bits, hand) for end in self._ends(place, status, cause)):
            known = sorted(map(str, self._ends(place, status, cause)))
            raise Unsound(f"{path} ends {status} {cause} with {bits:b}, hand {hand}; it was to be {known}")
        if cause == "tree.missing_input" and node.failure is not None and node.failure.node == path:
            self._announced(place, node.failure.message, path)

    def _ends(self, place: _Place, status: NodeStatus, cause: str) -> Iterator[State]:
        """The states in which the node may end so, as far as the analysis has come by."""
        wanted = UNREPORTED if not cause else self._walk.causes.matching(cause)
        for frame in self._walk.frames_of(place.tree):
            for (spec, _), flow in frame.memo.items():
                if spec != id(place.spec):
                    continue
                match status:
                    case NodeStatus.SUCCESS:
                        yield from flow.success
                    case NodeStatus.SKIPPED:
                        yield from flow.skipped
                    case _:
                        yield from (s for s, reasons in flow.failure.items() if reasons.any & wanted)

    def _allows(self, end: State, bits: int, hand: int) -> bool:
        return end.sure & ~bits == 0 and bits & ~end.maybe == 0 and hand & end.hand != 0

    def _cause(self, node: Node) -> str:
        return node.failure.cause.name if node.state is NodeStatus.FAILURE and node.failure else ""

    def _hand(self) -> int:
        if not self._world.holds:
            return EMPTY
        return self._walk.filler(self._places[self._world.holds].spec)

    def _bits(self, instance: SubTree, tree: str) -> int:
        """Which keys are written now, as the analysis numbers them."""
        layout = self._walk.layout_of(tree)
        bits = sum(bit for key, bit in layout.keys.items() if instance.inside.has(key))
        return bits | self._below(instance, instance.body, self._watched.mission.trees[tree].root, layout)

    def _below(self, instance: SubTree, node: Node, spec: NodeSpec, layout: Layout) -> int:
        bits = 0
        if isinstance(node, SubTree):
            shift, inner = layout.calls[id(spec)]
            inside = self._bits(node, spec.id)
            for port_ in inner.tree.ports:
                bound = spec.ports.get(port_.key)
                if bound is not None or port_.direction == "in":
                    inside &= ~inner.keys[port_.key]  # wired, or written anew at each start
            return inside << shift
        if id(spec) in layout.flags:
            bits |= sum(flag for flag, fact in zip(layout.flags[id(spec)], _facts(node, self._succeeded), strict=True) if fact)
        for below, child in zip(node.below, spec.children, strict=True):
            bits |= self._below(instance, below, child, layout)
        return bits

    def _announced(self, place: _Place, message: str, path: str) -> None:
        """A key that nothing has written: the analysis must have said so, here or where it is wired."""
        key = _unwritten(message)
        if not key:
            return
        while True:
            ports = {p.key for p in self._watched.mission.trees[place.tree].ports if p.direction == "in"}
            if key not in ports:
                break
            caller = self._callers[place.instance.path]
            bound = caller.spec.ports[key]
            assert isinstance(bound, Reference)
            place, key = caller, bound.key
        for read in self._walk.reads.values():
            if read.spec is place.spec and read.key == key and read.missing:
                return
        raise Unsound(f"{path}: {message}: nobody has said that {key!r} may be unwritten")


def _facts(node: Node, succeeded: Collection[str]) -> tuple[bool, ...]:
    """What outlasts the end of a node, as its flow has flags for it."""
    match node:
        case RunOnce():
            answer = getattr(node, "_first_answer")  # noqa: B009
            return bool(answer), answer == NodeStatus.FAILURE
        case _:
            return (node.path in succeeded,)


def _unwritten(message: str) -> str:
    for before, after in (("nothing has written {", "}"), ("unknown name '", "'"), ("nothing has written '", "'")):
        if before in message:
            return message.split(before, 1)[1].split(after, 1)[0].split(".")[0]
    return ""
