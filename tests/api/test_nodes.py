"""Nodes made in Python: their signatures, what an editor sees of them, and wrong arguments."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import picktree as pt
from picktree.authoring.schema import stub
from picktree.trees import Node
from picktree.trees.loading import NodeRegistry

from ..rooms import ROOT


def test_top_level_names_are_the_stubs() -> None:
    names = re.findall(r"^from \S+ import .* as (\w+)$", (ROOT / "__init__.pyi").read_text(), re.MULTILINE)
    assert sorted([*names, "__version__"]) == sorted(pt.__all__)
    assert all(getattr(pt, name) is not None for name in pt.__all__)
    assert set(pt.__all__) < set(dir(pt))


def test_help_tells_every_name() -> None:
    assert pt.__doc__ is not None
    told = [name for name in pt.__all__ if re.search(rf"\b{name}\b", pt.__doc__)]
    assert sorted({*pt.__all__} - {*told}) == ["__version__"]


def test_signature_shows_ports_with_defaults() -> None:
    assert str(inspect.signature(pt.ForEach)) == (
        "(*children: 'Child', in_: 'Iterable[object] | str', out: 'str' = None, "
        "on_failure: \"Literal['fail', 'continue'] | str\" = 'fail', most: 'int | str' = -1, "
        "name: 'str' = '', **conditions: 'Unpack[Conditions]')"
    )
    grasp = inspect.signature(pt.Grasp).parameters
    assert grasp["object"].default is inspect.Parameter.empty
    assert grasp["force"].annotation == "float | str"
    assert all(grasp[name].kind is inspect.Parameter.KEYWORD_ONLY for name in ("object", "force", "name"))


def test_docstring_has_units_and_bounds() -> None:
    doc = inspect.getdoc(pt.Grasp)
    assert doc is not None
    assert re.search(r"^ +force: .*, N; more than 0; default 70\.0\.$", doc, re.MULTILINE)
    assert re.search(
        r"^ +objects: .*\. Output: the key to write, as '\{objects\}'\.$", pt.Observe.__doc__ or "", re.M
    )


def test_every_node_is_in_the_stub_that_is_shipped() -> None:
    declared = NodeRegistry().declarations()
    assert stub(declared) == (ROOT / "apps" / "api" / "nodes.pyi").read_text(encoding="utf-8"), (
        "run make docs"
    )
    assert {node.id for node in declared} < set(dir(pt.nodes))


WRONG = {
    "unknown port": (
        lambda: pt.Grasp(object="a", forse=3),  # type: ignore[call-arg]
        "Grasp has no port 'forse' (did you mean 'force'?)",
    ),
    "missing port": (
        lambda: pt.Grasp(),  # type: ignore[call-arg]
        "Grasp: port 'object' is missing: the object to grasp",
    ),
    "word of Python": (
        lambda: pt.ForEach(pt.nodes.AlwaysSuccess(), im_="{a}"),  # type: ignore[call-arg]
        "ForEach has no port 'im_' (did you mean 'in_'?)",
    ),
    "condition": (
        lambda: pt.nodes.AlwaysSuccess(_skipif="a"),  # type: ignore[call-arg]
        "AlwaysSuccess has no port '_skipif' (did you mean '_skipIf'?)",
    ),
    "child of a leaf": (
        lambda: pt.Grasp(pt.Observe(), object="a"),  # type: ignore[call-arg, misc]
        "Grasp has no children; its ports are given by name, as Grasp(object=…)",
    ),
    "class as a child": (
        lambda: pt.Sequence(pt.Observe),  # type: ignore[arg-type]
        "Sequence: <class 'picktree.skills.observe.Observe'> is not a node; write Observe(…)",
    ),
    "no child": (lambda: pt.Sequence(), "Sequence: its children are missing: the steps, in this order"),
    "children twice": (
        lambda: pt.nodes.Inverter(pt.Observe(), do=pt.Observe()),  # type: ignore[call-arg]
        "Inverter has its children twice: in brackets and as 'do'",
    ),
    "table": (
        lambda: pt.Recover(pt.Observe(), when=[pt.Observe()]),  # type: ignore[arg-type]
        "Recover: 'when' is a mapping: cause, or family of causes, and its handler, which may cure "
        "the failure",
    ),
    "value": (
        lambda: pt.Grasp(object=SimpleNamespace(id="red_block_1")),  # type: ignore[arg-type]
        "port 'object' of Grasp: a value of type SimpleNamespace is not allowed in a mission; its id is a "
        "text: give '.id'",
    ),
    "port of a tree": (
        lambda: pt.SubTree(pt.Tree("One", pt.Observe(), {"item": "object"}), itm="{a}"),
        "One has no port 'itm' (did you mean 'item'?)",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_argument(wrong: str) -> None:
    make, message = WRONG[wrong]
    with pytest.raises(TypeError) as raised:
        make()  # type: ignore[no-untyped-call]
    assert str(raised.value) == message


def test_unknown_node_has_the_nearest_name() -> None:
    with pytest.raises(AttributeError, match=r"^there is no node 'Gasp' \(did you mean 'Grasp'\?\)$"):
        _ = pt.nodes.Gasp  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match=r"^there is no node 'Selector' \(did you mean 'Fallback'\?\)$"):
        _ = pt.nodes.Selector  # type: ignore[attr-defined]


def test_values_of_numpy_are_plain() -> None:
    place = pt.Place(object="a", at=np.array([0.4, 0.0, 0.1]), speed=np.float64(0.5))  # type: ignore[arg-type]
    assert repr(place) == "Place: {object: a, at: [0.4, 0.0, 0.1], speed: 0.5}"


def test_node_reads_as_in_a_file() -> None:
    tree = pt.Recover(
        pt.Observe(camera="overhead"),
        pt.Observe(name="again"),
        when={"perception.*": [pt.nodes.SafeRetreat()]},
    )
    assert repr(tree).splitlines() == [
        "Recover:",
        "  do:",
        "    - Observe: {camera: overhead}",
        "    - Observe: {name: again}",
        "  when: {perception.*: [SafeRetreat]}",
    ]


def test_class_of_a_running_tree_is_the_same() -> None:
    assert issubclass(pt.nodes.Grasp, Node)
    assert pt.Grasp is pt.nodes.Grasp is NodeRegistry().find("Grasp")


PROGRAM = """
import picktree as pt
pt.Grasp(object="a", force="20 N")
pt.ForEach(pt.Grasp(object="{item}"), in_="{items}", out="{item}", _skipIf="held")
pt.Grasp(object="a", forse=3)
pt.Grasp(object="a", force=[1])
pt.Grasp()
pt.Observe(camera="overhead", _skipif="held")
pt.Sequence(3)
pt.run("first.yaml", seeds=3)
"""


def test_type_checker_sees_wrong_ports(tmp_path: Path) -> None:
    file = tmp_path / "program.py"
    file.write_text(PROGRAM, encoding="utf-8")
    (tmp_path / "pyrightconfig.json").write_text(
        json.dumps({"venvPath": str(ROOT), "venv": ".venv", "extraPaths": [str(ROOT / "links")]})
    )
    pyright = Path(sys.executable).with_name("pyright")
    ran = subprocess.run(
        [str(pyright), "--outputjson", "-p", str(tmp_path)], cwd=tmp_path, capture_output=True, text=True
    )
    told = json.loads(ran.stdout)["generalDiagnostics"]
    found = {each["range"]["start"]["line"]: each["rule"] for each in told if each["severity"] == "error"}
    assert found == {
        4: "reportCallIssue",
        5: "reportArgumentType",
        6: "reportCallIssue",
        7: "reportCallIssue",
        8: "reportArgumentType",
        9: "reportCallIssue",
    }
