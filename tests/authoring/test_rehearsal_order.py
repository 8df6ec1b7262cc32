"""The order of leaves, and the first place where it is otherwise than expected."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.authoring.rehearsal.cases import ExpectedStart
from picktree.authoring.rehearsal.trace import LeafRun
from picktree.authoring.rehearsal.verdict import compare_order

RUNS = [
    LeafRun(1, "Main/Look", 1, "SUCCESS"),
    LeafRun(1, "Main/One/Pick", 3, "FAILURE", "grasp.missed"),
    LeafRun(4, "Main/One/when/Look", 4, "SUCCESS"),
    LeafRun(5, "Main/One/Pick", 7, "SUCCESS"),
    LeafRun(8, "Main/Go", None, "RUNNING"),
]


def first_wrong(order: str) -> str | None:
    """`Pick=grasp.*` is a turn with an outcome; the place of the wrong one, and what is wrong."""
    turns = [ExpectedStart(*word.partition("=")[::2]) for word in order.split()]
    found = compare_order(turns, RUNS, ("order",))
    if found is None:
        return None
    return f"{found.loc[-1]} {found.message} ({found.tick})"


@pytest.mark.parametrize(
    "order",
    [
        "Main/Look One/Pick One/Look One/Pick Go",
        "Look=SUCCESS Pick=FAILURE Look Pick=SUCCESS Go=RUNNING",
        "Look Pick=grasp.missed Look Pick Go",
        "Look Pick=grasp.* Look Pick Go",
        "Look Pick=* ... Go",
        # The first Pick is not the one that Go follows: a later one must be found.
        "... Pick Go ...",
    ],
)  # fmt: skip
def test_it_holds(order: str) -> None:
    assert first_wrong(order) is None


@pytest.mark.parametrize(
    ("order", "wrong"),
    [
        ("Pick", "0 Pick is expected, but Main/Look starts (1)"),
        ("Look Look", "1 Look is expected, but Main/One/Pick starts (1)"),
        ("Look Pick Look Pick", "order the order ends, but Main/Go starts (8)"),
        ("Look Pick Look Pick Go Go", "5 Go is expected, but no further leaf starts (None)"),
        ("Look Pick=SUCCESS ...", "1 SUCCESS is expected of Main/One/Pick, which is grasp.missed (1)"),
        ("Look Pick=grasp.slipped ...",
         "1 grasp.slipped is expected of Main/One/Pick, which is grasp.missed (1)"),
        ("... Pick Pick ...", "2 Pick is expected, but Main/One/when/Look starts (4)"),
        ("... Drop Go ...", "1 Drop is expected, but does not come (None)"),
        ("... Drop ...", "1 Drop is expected, but does not come (None)"),
        ("Look Pick ... Drop ...", "3 Drop is expected after Main/One/Pick, but does not come (1)"),
        ("... Look Pick=SUCCESS Look ...", "3 Look is expected, but Main/Go starts (8)"),
        ("... Pick", "1 Pick is expected, but Main/Go starts (8)"),
        ("Look Pick Look Pick Go ... Go", "6 Go is expected after Main/Go, but does not come (8)"),
        # Two Looks and two Picks are there, three are not.
        ("... Look ... Look ... Look ...",
         "5 Look is expected after Main/One/when/Look, but does not come (4)"),
        ("... Look ... Look ... Look", "5 Look is expected, but Main/Go starts (8)"),
    ],
)  # fmt: skip
def test_the_first_that_does_not(order: str, wrong: str) -> None:
    assert first_wrong(order) == wrong


@given(
    st.lists(st.sampled_from(["a", "b", "..."]), max_size=7),
    st.lists(st.sampled_from(["a", "b"]), max_size=9),
)
def test_it_is_the_match_of_a_regular_expression(order: list[str], started: list[str]) -> None:
    expression = "".join(".*" if word == "..." else word for word in order)
    turns = [ExpectedStart(word) for word in order]
    runs = [LeafRun(n + 1, f"Main/{name}", n + 1, "SUCCESS") for n, name in enumerate(started)]
    matches = re.fullmatch(expression, "".join(started)) is not None
    assert (compare_order(turns, runs, ()) is None) is matches


def test_no_leaf_at_all() -> None:
    assert compare_order([], [], ("order",)) is None
    assert compare_order([ExpectedStart("...")], [], ("order",)) is None
    found = compare_order([], RUNS, ("order",))
    assert found is not None
    assert found.message == "the order ends, but Main/Look starts"
