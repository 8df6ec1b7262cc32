"""A small world without a robot, and leaves that do what the test's text says, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING, ClassVar, cast

from picktree.files import ANY, ValueType
from picktree.trees import ARM, BehaviourTree, In, Mission, Node, NodeStatus, Out, Skill, Steps, build, port
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import (
    BeliefObject,
    Box,
    Entry,
    Failure,
    FailureReport,
    Journal,
    JournalEvent,
    NodeState,
    ObjectId,
    Plain,
    PlanningScene,
    Pose,
    RandomStreams,
    Tick,
    cause_named,
    control,
    grasp,
    perception,
    safety,
)
from picktree.world.world_facts import AttemptMemory

if TYPE_CHECKING:
    from picktree.robot import World

TICK = 0.05


class FakeClock:
    def __init__(self) -> None:
        self.now = 0.0


class StandingArm:
    """An arm that is never on the way when a skill begins."""

    ongoing: None = None


@dataclass
class FakeWorld:
    clock: FakeClock = field(default_factory=FakeClock)
    scene: PlanningScene = field(
        default_factory=lambda: PlanningScene((), (), lambda o: ObjectId(f"{o.colour}_bin"))
    )
    journal: Journal = field(default_factory=Journal)
    attempts: AttemptMemory = field(default_factory=AttemptMemory)
    streams: RandomStreams = field(default_factory=lambda: RandomStreams(0))
    move: StandingArm = field(default_factory=StandingArm)
    known: dict[str, object] = field(default_factory=dict[str, object])
    trace: list[str] = field(default_factory=list[str])
    """What the scripted leaves did, in order."""

    def facts(self) -> Mapping[str, object]:
        return {"time": self.clock.now, **self.known}

    def put(self, identity: str, colour: str, **changes: object) -> None:
        belief = BeliefObject(
            "cube",
            "box",
            Box((0.04, 0.04, 0.04)),
            colour,
            Pose(),
            0.001,
            0.01,
            0.9,
            0.0,
            id=ObjectId(identity),
        )
        self.scene.put(replace(belief, **cast("dict[str, str]", changes)), "test")


class Scripted(Skill):
    """Does what its script says: R one tick RUNNING, S succeed, F fail without end, or a cause to fail with.

    `script` is words for each activation, divided by `|`; the last is used again. `RR S` runs two ticks.
    """

    script: In[str] = port("what it does", default="S")
    causes = (grasp.ANY, perception.ANY, control.ANY, safety.ANY)
    uses = (ARM,)
    activations: ClassVar[dict[str, int]] = {}

    def run(self, world: World) -> Steps:
        fake = cast("FakeWorld", world)
        n = fake.trace.count(f"start {self.name}")
        fake.trace.append(f"start {self.name}")
        turns = self.script.split("|")
        ended = False
        try:
            for word in turns[min(n, len(turns) - 1)].split():
                if set(word) == {"R"}:
                    for _ in word:
                        fake.trace.append(f"run {self.name}")
                        yield
                elif word == "crash":
                    raise ZeroDivisionError("scripted")
                elif word != "S":
                    raise Failure(cause_named(word), f"{self.name} was told to", turn=n)
            ended = True
        finally:
            fake.trace.append(f"{'end' if ended else 'leave'} {self.name}")


class Answer(Node):
    """Answers one letter of `script` at each tick: S, F, R or K for SKIPPED; the last is used again."""

    kind = "action"
    script: In[str] = port("one letter for each tick")

    asked: int = 0

    def on_tick(self) -> NodeStatus:
        fake = cast("FakeWorld", self.world)
        letter = self.script[min(self.asked, len(self.script) - 1)]
        self.asked += 1
        fake.trace.append(f"{self.name}:{letter}")
        return {"S": NodeStatus.SUCCESS, "F": NodeStatus.FAILURE, "R": NodeStatus.RUNNING}.get(
            letter, NodeStatus.SKIPPED
        )

    def on_halt(self) -> None:
        cast("FakeWorld", self.world).trace.append(f"halt {self.name}")


class Find(Skill):
    """Finds the ids that its script names."""

    ids: In[list[str]] = port("what it finds")
    found: Out[list[ObjectId]] = port("what was found")

    def run(self, world: World) -> Steps:
        yield
        self.found = [ObjectId(i) for i in self.ids]


class Take(Skill):
    """Takes an object and says which, of what colour, and with what force."""

    object: In[ObjectId] = port("what to take")
    force: In[float] = port("grip force", unit="N", default=30.0)
    colour: In[str] = port("its colour", default="")
    hand: In[str] = port("which hand", default="left", choices=("left", "right"))
    causes = (grasp.ANY,)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        yield
        cast("FakeWorld", world).trace.append(f"take {self.object} {self.colour} {self.force:g}".strip())


NODES: tuple[type[Node], ...] = (Scripted, Answer, Find, Take)
FILE = Path("mission.yaml")


def registry() -> NodeRegistry:
    return NodeRegistry(NODES, installed=False)


class AnyFacts(Mapping[str, ValueType]):
    """Whatever a test puts into `FakeWorld.known`, or writes to the blackboard itself."""

    def __getitem__(self, name: str) -> ValueType:
        return ANY

    def __contains__(self, name: object) -> bool:
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


def mission(body: str) -> Mission:
    """A mission whose `trees:` is the given text."""
    indented = "\n".join(f"  {line}" for line in dedent(body).strip().splitlines())
    text = f"picktree: 1\nkind: mission\ntrees:\n{indented}\n"
    return parse_mission(text, FILE, registry(), facts=AnyFacts())


def state_of(node: Node) -> NodeState:
    """The state of a node as the node itself has it."""
    failure = node.failure
    message, cause = (failure.message, failure.cause.name) if failure else (node.feedback_message, "")
    evidence = dict(failure.evidence) if failure else {}
    return NodeState(node.path, node.wiring.id, node.state, node.ticked, message, cause, evidence)


@dataclass
class Run:
    """A tree with its world; `tick` lets one tick of simulated time pass afterwards."""

    tree: BehaviourTree
    world: FakeWorld

    def tick(self) -> NodeStatus:
        """Tick once; the transitions of the tick must lead from the states before to those after it."""
        states = {node.path: state_of(node) for node in self.tree.nodes}
        self.report: Tick = self.tree.tick()
        for each in self.report.transitions:
            states[each.path] = each.state(states[each.path].id)
        assert tuple(states.values()) == self.report.nodes == tuple(map(state_of, self.tree.nodes))
        self.world.clock.now += TICK
        return self.tree.status

    def to_end(self, most: int = 200) -> list[NodeStatus]:
        """The root's status after each tick, until it no longer runs."""
        seen = [self.tick()]
        while seen[-1] is NodeStatus.RUNNING and len(seen) < most:
            seen.append(self.tick())
        return seen

    def status(self, path: str) -> NodeStatus:
        return self.tree.find(path).state

    @property
    def trace(self) -> list[str]:
        return self.world.trace

    @property
    def failure(self) -> FailureReport:
        """Failure of the mission, which has one."""
        assert self.tree.failure is not None
        return self.tree.failure

    def notes(self, kind: str) -> list[JournalEvent]:
        entries: tuple[Entry, ...] = self.world.journal.take()
        return [e for e in entries if isinstance(e, JournalEvent) and e.kind == kind]


def run_of(mission: Mission, world: FakeWorld | None = None, **parameters: Plain) -> Run:
    world = world or FakeWorld()
    return Run(build(mission, cast("World", world), parameters), world)


def start(body: str, world: FakeWorld | None = None, **parameters: Plain) -> Run:
    return run_of(mission(body), world, **parameters)


def letters(statuses: list[NodeStatus]) -> str:
    """`[RUNNING, SUCCESS]` as `RS`; SKIPPED is K, IDLE is I."""
    return "".join("K" if s is NodeStatus.SKIPPED else s.value[0] for s in statuses)


_LINES = [line.strip() for line in Path(__file__).read_text(encoding="utf-8").splitlines()]
CRASH_LINE = 1 + _LINES.index('raise ZeroDivisionError("scripted")')
"""Line of this file at which a `crash` in a script is raised."""
