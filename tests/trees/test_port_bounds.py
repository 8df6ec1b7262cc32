"""Bounds of numbers: declared with a port, held when a mission is read and when a value comes in."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import FileError, PicktreeError
from picktree.trees import ConditionNode, In, PortType, Range, convert_literal, port
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.trees.port_types import accept_value


def fault_of(node: str) -> str:
    text = f"picktree: 1\nkind: mission\ntrees:\n  Main: {{{node}}}\n"
    with pytest.raises(FileError) as wrong:
        parse_mission(text, Path("m.yaml"), NodeRegistry())
    (fault,) = wrong.value.faults
    return fault.message


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ("GoTo: {speed: 1.5}", "port 'speed': 1.5 is more than 1"),
        ("GoTo: {speed: 150 %}", "port 'speed': 150 % is more than 100 %"),
        ("GoTo: {speed: 0}", "port 'speed': 0 is not more than 0"),
        ("OpenGripper: {width: -1 mm}", "port 'width': -1 mm is less than 0 mm"),
        ("Timeout: {msec: -1 s, do: AlwaysSuccess}", "port 'msec': -1 s is less than 0 s"),
        ("Delay: {delay_msec: -5, do: AlwaysSuccess}", "port 'delay_msec': -5 is less than 0"),
        (
            "Recover: {attempts: 0, do: AlwaysSuccess, otherwise: AlwaysSuccess}",
            "port 'attempts': 0 is less than 1",
        ),
    ],
)
def test_literal_out_of_bounds_is_a_fault(node: str, message: str) -> None:
    assert fault_of(node) == message


def test_bound_holds_for_each_element_and_for_what_is_written_at_run_time() -> None:
    share = Range(above=0, most=1)
    with pytest.raises(ValueError, match="2 is more than 1"):
        convert_literal([0.5, 2], PortType("float", many=True), None, None, share)
    with pytest.raises(ValueError, match="0 is not more than 0"):
        accept_value(0, PortType("float"), None, share)
    assert accept_value(1, PortType("float"), None, share) == 1.0


def test_default_out_of_bounds_is_refused_with_the_declaration() -> None:
    with pytest.raises(PicktreeError, match=r"port Odd\.share: its default: 2 is more than 1"):

        class Odd(ConditionNode):  # pyright: ignore[reportUnusedClass]
            """A node with a wrong default."""

            share: In[float] = port("a share", default=2.0, most=1)

            def answer(self, world: object) -> bool:
                return False


def test_words() -> None:
    assert Range(above=0, most=1).words() == "more than 0, at most 1"
    assert Range().words() == ""
