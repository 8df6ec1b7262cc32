"""Ticks decoded by their differences equal ticks decoded as a whole, whatever the texts in them look like."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.logs import encode
from picktree.logs.log_records import (
    NodeStatusRecord,
    Tick,
    TickDecoder,
    TransitionRecord,
    WriteRecord,
    changes_of,
    decode,
)

A = NodeStatusRecord("Main", "Main", "RUNNING", ticked=True, message="", cause="")
B = NodeStatusRecord("Main/Grasp", "Grasp", "RUNNING", ticked=True, message="closes", cause="")
FAILED = replace(B, status="FAILURE", cause="grasp.slipped", message="it slipped", evidence={"opening": 0.02})
LOOKS_LIKE_NODES = replace(
    B, message='},{"path":"x"}],"writes":[', evidence={"a": [{"path": "p"}, {"path": "q"}], "writes": []}
)
WRITE = WriteRecord("Main/items", [{"path": "p"}, {"a": [1], "writes": [{}]}], "Main/Observe")
ENDED = TransitionRecord("Main/Grasp", "FAILURE", cause="grasp.slipped", origin="Main/Grasp")
TICKS = (
    Tick("RUNNING", B.path, (A, B)),
    Tick("RUNNING", B.path, (A, B)),
    Tick("RUNNING", B.path, (A, replace(B, message="lifts")), (WRITE,)),
    Tick("RUNNING", B.path, (A, LOOKS_LIKE_NODES), (WRITE,), (ENDED,)),
    Tick("RUNNING", B.path, (A, LOOKS_LIKE_NODES)),
    Tick("RUNNING", '],"writes":[', (A, FAILED), (), (ENDED,)),
    Tick("RUNNING", "Main/Place", (A, FAILED, replace(B, path="Main/Place"))),  # the mission was edited
    Tick("SUCCESS", "", ()),
    Tick("RUNNING", B.path, (A, B)),
)


def test_each_tick_is_that_of_the_whole_text() -> None:
    decoder = TickDecoder()
    assert [decoder.tick(encode(tick)) for tick in TICKS] == list(TICKS)


def test_a_node_that_reports_the_same_is_the_same_record() -> None:
    decoder = TickDecoder()
    first, second, third = (decoder.tick(encode(tick)).nodes for tick in TICKS[:3])
    assert all(a is b for a, b in zip(first, second, strict=True))
    assert third[0] is second[0]
    assert third[1] == replace(B, message="lifts")


def test_the_changes_of_a_tick_are_all_but_its_nodes() -> None:
    assert [changes_of(encode(tick)) for tick in TICKS] == [replace(tick, nodes=()) for tick in TICKS]


@pytest.mark.parametrize("data", [b"", b"{", b'{"root_status":"RUNNING","tip":"","nodes":[{"path":"Main"}]}'])
def test_what_is_no_tick_is_refused_as_before(data: bytes) -> None:
    for read in (TickDecoder().tick, changes_of, lambda text: decode(Tick, text)):
        with pytest.raises(ValueError):
            read(data)


def test_a_tick_after_an_unreadable_one_is_read() -> None:
    decoder = TickDecoder()
    decoder.tick(encode(TICKS[0]))
    with pytest.raises(ValueError):
        decoder.tick(encode(TICKS[2]).replace(b'"lifts"', b"7"))
    assert decoder.tick(encode(TICKS[1])) == TICKS[1]
