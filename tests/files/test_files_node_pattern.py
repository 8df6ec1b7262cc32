"""Patterns that name nodes of a tree."""

from __future__ import annotations

import pytest

from picktree.files import PicktreeError, find_node, find_nodes, node_matches

from ..logs.scripted_log import tree


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


def test_nodes_are_called_by_path_end_type_or_pattern() -> None:
    nodes = tree("Main:ForEach", "Main/Part:Sequence", "Main/Part/Grasp", "Main/Part/Place").nodes
    assert [node.path for node in find_nodes("Main/Part", nodes)] == ["Main/Part"]
    assert [node.path for node in find_nodes("Part/Grasp", nodes)] == ["Main/Part/Grasp"]
    assert [node.path for node in find_nodes("Sequence", nodes)] == ["Main/Part"]
    assert [node.path for node in find_nodes("Part/*", nodes)] == ["Main/Part/Grasp", "Main/Part/Place"]
    with pytest.raises(PicktreeError, match=r"^2 nodes fit 'Part/\*': Main/Part/Grasp, Main/Part/Place$"):
        find_node("Part/*", nodes)
