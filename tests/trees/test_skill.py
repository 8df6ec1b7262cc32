"""The skill base: ports, life cycle, halting, faults of the body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

import pytest

from picktree.files import PicktreeError
from picktree.trees import In, Node, NodeStatus, Out, Skill, Steps, port
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world.event_types import InternalErrorEvent

from .scripted import CRASH_LINE, FILE, NODES, FakeWorld, Run, letters, run_of, start

if TYPE_CHECKING:
    from picktree.robot import World


class Stubborn(Skill):
    """Yields while it is closed."""

    def run(self, world: World) -> Steps:
        try:
            yield
        finally:
            yield


class Exploding(Skill):
    """Crashes while it is closed."""

    def run(self, world: World) -> Steps:
        try:
            yield
        finally:
            raise OSError("no")


class Forgetful(Skill):
    """Does not write its outputs."""

    width: Out[float] = port("a width")
    other: Out[str] = port("another")

    def run(self, world: World) -> Steps:
        yield
        self.other = "x"


class Wrong(Skill):
    """Writes an output of another type."""

    width: Out[float] = port("a width")

    def run(self, world: World) -> Steps:
        yield
        self.width = cast("float", "wide")


class Plain(Skill):
    """Is no generator."""

    def run(self, world: World) -> Steps:
        return cast("Steps", None)


class Watcher(Skill):
    """Looks at its input in each of three ticks."""

    count: In[int] = port("a number")
    ratio: In[float] = port("a ratio", default=0.5)
    maybe: In[str | None] = port("perhaps a text", default=None)
    side: In[Literal["left", "right"]] = port("a side", default="left")
    places: In[list[float]] = port("places", unit="m", default=[])

    def run(self, world: World) -> Steps:
        for _ in range(3):
            cast("FakeWorld", world).trace.append(
                f"{self.count} {self.ratio} {self.maybe} {self.side} {self.places}"
            )
            self.places.append(1.0)
            yield


HERE: tuple[type[Node], ...] = (Stubborn, Exploding, Forgetful, Wrong, Plain, Watcher)


def begin(body: str) -> Run:
    registry = NodeRegistry((*NODES, *HERE), installed=False)
    return run_of(parse_mission(f"picktree: 1\nkind: mission\ntrees: {{Main: {body}}}", FILE, registry))


@pytest.mark.parametrize("ticks", [1, 2, 3])
def test_halting_closes_the_body_at_any_tick(ticks: int) -> None:
    run = begin("{Scripted: {script: RRRR S}}")
    for _ in range(ticks):
        run.tick()
    run.tree.halt()
    assert run.trace[-1] == "leave Scripted"
    assert run.tree.status is NodeStatus.IDLE
    assert letters(run.to_end()) == "RRRRS"


@pytest.mark.parametrize("name", ["Stubborn", "Exploding"])
def test_a_body_that_resists_halting_does_not_keep_its_siblings_from_it(name: str) -> None:
    run = begin(
        f"{{Parallel: [{{Scripted: {{name: A, script: RR}}}}, {name}, "
        "{Scripted: {name: B, script: RR}}]}"
    )
    run.tick()
    run.tree.halt()
    assert [line for line in run.trace if line.startswith("leave")] == ["leave A", "leave B"]
    assert {n.state for n in run.tree.nodes} == {NodeStatus.IDLE}
    notes = run.notes("internal_error")
    assert [n.node for n in notes] == [f"Main/Parallel/{name}"]
    assert (
        notes[0].message
        == {
            "Stubborn": "Stubborn yields while it is halted: a finally cannot wait",
            "Exploding": "OSError while Exploding was halted: no (test_skill.py, line 37)",
        }[name]
    )
    if name == "Exploding":
        assert isinstance(notes[0], InternalErrorEvent)
        assert 'raise OSError("no")' in str(notes[0].traceback)


def test_a_crash_is_an_internal_error_with_its_traceback() -> None:
    run = begin("{Scripted: {script: R crash}}")
    assert letters(run.to_end()) == "RF"
    report = run.failure
    assert str(report.cause) == "internal.error"
    assert (
        report.message
        == f"ZeroDivisionError while Scripted was ticked: scripted (scripted.py, line {CRASH_LINE})"
    )
    assert 'raise ZeroDivisionError("scripted")' in str(report.evidence["traceback"])
    assert [n.message for n in run.notes("internal_error")] == [report.message]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Forgetful", "Forgetful ended without writing its output 'width'"),
        (
            "Wrong",
            "TypeError while Wrong was ticked: output 'width': 'wide' is not a number "
            "(test_skill.py, line 58)",
        ),
        ("Plain", "TypeError while Plain was ticked: 'NoneType' object is not iterable"),
    ],
)
def test_a_skill_that_breaks_its_contract_is_an_internal_error(name: str, message: str) -> None:
    run = begin(name)
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert (str(run.failure.cause), run.failure.message) == ("internal.error", message)


def test_inputs_are_read_once_and_are_copies() -> None:
    run = begin(
        "{Sequence: [{SetBlackboard: {value: 7, output_key: '{n}'}}, "
        "{Watcher: {count: '{n}', ratio: 2, side: right, places: [30 mm]}}]}"
    )
    run.tick()
    run.tree.blackboard.write("Main/n", 8, "test")
    run.tick()
    assert run.trace == ["7 2.0 None right [0.03]", "7 2.0 None right [0.03, 1.0]"]
    run.tree.halt()
    run.tick()
    assert run.trace[-1] == "7 2.0 None right [0.03]"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (None, "input 'count' of Watcher: {n} is empty"),
        ("seven", "input 'count' of Watcher: {n}: 'seven' is not a whole number"),
        ("unwritten", "input 'count' of Watcher: nothing has written {n} yet"),
    ],
)
def test_a_missing_input_is_a_failure(value: str | None, message: str) -> None:
    run = begin("{Watcher: {count: '{n}'}}")
    if value != "unwritten":
        run.tree.blackboard.write("Main/n", value, "test")
    assert run.tick() is NodeStatus.FAILURE
    report = run.failure
    assert (str(report.cause), report.message) == ("tree.missing_input", message)
    assert report.evidence == {"port": "count", "reference": "{n}"}


def test_start_hooks_hear_of_each_start_before_the_inputs_are_read() -> None:
    run = start(
        """
        Main:
          RetryUntilSuccessful:
            num_attempts: 2
            do: {Take: {object: "{thing}"}}
        """
    )
    heard: list[str] = []

    def hook(path: str) -> None:
        heard.append(path)
        if path.endswith("Take"):
            run.tree.blackboard.write("Main/thing", "red_1", "hook")

    run.tree.on_start.append(hook)
    assert letters(run.to_end()) == "RS"
    assert heard == ["Main", "Main/RetryUntilSuccessful", "Main/RetryUntilSuccessful/Take"]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("status: In[str] = port('x')", "node Odd: 'status' would hide an attribute that every node has; "
         "use another attribute, and key='status' if the file must say 'status'"),
        ("a: str = port('x')", "port Odd.a: annotate it as In[...] or Out[...]"),
        ("a: In[dict[str, int]] = port('x')", "port Odd.a: dict[str, int] cannot be the type of a port"),
        ("a: In[int] = port('x', default='b')", "port Odd.a: its default: 'b' is not a whole number"),
        ("a: In[float] = port('x', default=2.0, most=1)", "port Odd.a: its default: 2 is more than 1"),
        ("a: In[Nowhere] = port('x')",
         "node Odd: the type of a port cannot be read: name 'Nowhere' is not defined"),
        ("a: In[int] = port('x', key='c')\n    b: In[int] = port('x', key='c')",
         "node Odd: the key 'c' is declared twice"),
        ("a: In[int] = port('x', key='name')", "port Odd.a: 'name' cannot be a key"),
        ("__doc__ = None", "node Odd: the class needs a docstring, for the reference of nodes"),
        ("node_id = 'Two words'", "node 'Two words': an ID is a letter or '_', then letters, digits and '_'"),
    ],
)  # fmt: skip
def test_a_declaration_that_cannot_be_is_refused_when_the_class_is_made(body: str, message: str) -> None:
    with pytest.raises(PicktreeError) as caught:
        exec(f"class Odd(Skill):\n    'A node.'\n    {body}", dict(globals()))
    assert str(caught.value) == message
