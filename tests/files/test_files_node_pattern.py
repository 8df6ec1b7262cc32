"""Patterns that name nodes of a tree."""

from __future__ import annotations

import pytest

from picktree.files import node_matches


@pytest.mark.parametrize(
    ("pattern", "path", "fits"),
    [
        ("Grasp", "Main/SortOne/Sequence/Grasp", True),
        ("Grasp", "Main/Grasp/Other", False),
        ("SortOne/Grasp", "Main/SortOne/Sequence/Grasp", True),
        ("Grasp/SortOne", "Main/SortOne/Sequence/Grasp", False),
        ("Main/*/Grasp", "Main/SortOne/Grasp", True),
        ("Main/*/Grasp", "Main/Grasp", False),
        ("Gr?sp", "/Main/Grasp", True),
        ("Grasp", "Main/Grasp#2", True),
        ("Grasp#2", "Main/Grasp#2", True),
        ("Grasp#2", "Main/Grasp", False),
        ("grasp", "Main/Grasp", False),
        ("/", "Main", False),
        ("/Main/Grasp", "Main/Grasp", True),
        ("/Main/Grasp", "Main/SortOne/Grasp", False),
        ("/Main/*/Grasp", "Main/SortOne/Grasp", True),
        ("/Grasp", "Main/Grasp", False),
        ("SortOne/perception.*/Observe", "Main/SortOne/Recover/perception.*/Observe", True),
        ("take [left]", "Main/take [left]", True),
    ],
)
def test_which_nodes_a_pattern_means(pattern: str, path: str, fits: bool) -> None:
    assert node_matches(pattern, path) is fits
