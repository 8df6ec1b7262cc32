"""What a picture shows of a mission, and the mission as indented text and as Graphviz text."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from picktree.authoring import chart, chart_of_file, svg, text
from picktree.authoring.dot_drawing import dot
from picktree.authoring.drawing import drawing_text, suffix_of
from picktree.authoring.mission_chart import Chart, ChartPort
from picktree.files import PicktreeError
from picktree.trees.loading import parse_mission

from ..other_process import OtherProcess
from ..trees.scripted import mission
from .drawn import SHIFT, shift

BODY = """
Main:
  ports: {rounds: {type: int, default: 2, doc: how often}}
  Repeat:
    num_cycles: "{rounds}"
    do:
      - Find: {ids: [a, b], found: "{items}", _skipIf: time > 3}
      - ForEach: {in: "{items}", out: "{item}", do: {Handle: {item: "{item}"}}}
Handle:
  ports: {item: object}
  IfThenElse:
    - Condition: {if: "item.colour == 'red'"}
    - Take: {name: the red one, object: "{item}", force: 12 N, breakpoint: before, _onSuccess: done := 1}
    - Switch:
        variable: "{item.kind}"
        cases: {cube: [AlwaysSuccess, AlwaysSuccess], ball: AlwaysFailure}
        default: {Scripted: {script: ""}}
"""


def charted(body: str = BODY) -> Chart:
    return chart(mission(body))


def test_text_shows_the_trees_with_ports_labels_conditions_and_breakpoints() -> None:
    assert text(charted(), columns=110) == dedent(
        """\
        mission

        Main  rounds: int = 2
        └── ↻ Repeat  num_cycles: {rounds}
            └── → Sequence
                ├── □ Find  [_skipIf: time > 3]  ids: [a, b]  found → {items}
                └── ↻ ForEach  in: {items}  out → {item}
                    └── ▣ Handle  item: {item}

        Handle  item: object
        └── ◇ IfThenElse
            ├── if: ○ Condition  if: item.colour == 'red'
            ├── then: □ Take the red one  ● stops before  object: {item}  force: 12 N  [_onSuccess: done := 1]
            └── else: ◇ Switch  variable: {item.kind}
                ├── cube:
                │   ├── □ AlwaysSuccess
                │   └── □ AlwaysSuccess#2
                ├── ball: □ AlwaysFailure
                └── default: □ Scripted  script: ""
        """
    )


def test_expanded_text_writes_what_is_called_below_the_call() -> None:
    assert text(charted(), expand=True).splitlines()[7:10] == [
        "            └── ▣ Handle  item: {item}",
        "                └── ◇ IfThenElse",
        "                    ├── if: ○ Condition  if: item.colour == 'red'",
    ]


def test_the_assignments_of_a_script_are_shown_once() -> None:
    drawn = text(chart(mission('Main: {Script: {code: "n := 1", _onSuccess: "m := 2"}}'))).splitlines()
    assert drawn[-1] == "└── □ Script  code: n := 1  [_onSuccess: m := 2]"


def test_recovery_is_shown_by_cause() -> None:
    root = shift().tree("SortOne").root
    assert (root.symbol, root.branches[0].role) == ("recover", "child")
    cures = [branch.label for branch in root.branches[1:] if branch.role == "cure"]
    assert cures[:2] == ["when perception.*", "when world.disturbed"]
    assert cures[-2:] == ["otherwise", "give_up"]
    assert len(cures) == len(root.branches) - 1 == 12


def test_recovery_node_has_a_recovery_branch() -> None:
    head = "picktree: 1\nkind: mission\ntrees: "
    text = head + "{Main: {RecoveryNode: [AlwaysSuccess, AlwaysFailure]}}"
    root = chart(parse_mission(text, Path("m.yaml"))).trees[0].root
    assert [(branch.label, branch.role) for branch in root.branches] == [("", "child"), ("recovery", "cure")]
    assert root.symbol == "recover"


def test_ports_tell_values_from_references_and_from_outputs() -> None:
    find = next(node for node in charted().trees[0].root.iterate() if node.id == "Find")
    assert find.ports == (
        ChartPort("ids", "[a, b]", "literal", "what it finds (list of string)"),
        ChartPort("found", "{items}", "output", "what was found (list of object)"),
    )
    take = next(node for node in charted().trees[1].root.iterate() if node.id == "Take")
    assert [(port.key, port.value, port.role) for port in take.ports] == [
        ("object", "{item}", "reference"),
        ("force", "12 N", "literal"),
    ]
    assert [(port.key, port.value) for port in take.defaults] == [("colour", '""'), ("hand", "left")]
    assert (take.place, take.given_name, take.breakpoint) == ("mission.yaml:15", "the red one", "before")


def test_unused_trees_come_last_and_included_ones_only_where_they_are_used(tmp_path: Path) -> None:
    (tmp_path / "parts.yaml").write_text(
        "picktree: 1\nkind: mission\nlibrary: true\ntrees:\n  Used: AlwaysSuccess\n  Unused: AlwaysSuccess\n"
    )
    (tmp_path / "m.yaml").write_text(
        "picktree: 1\nkind: mission\ninclude: [parts.yaml]\ntrees:\n"
        "  Idle: AlwaysSuccess\n  Main: {Sequence: [Used, Own]}\n  Own: AlwaysSuccess\n"
    )
    found = chart_of_file(tmp_path / "m.yaml")
    assert [tree.name for tree in found.trees] == ["Main", "Used", "Own", "Idle"]
    assert found.tree("Used").place == "parts.yaml:5"


@pytest.mark.parametrize("columns", [70, 80, 100])
def test_no_line_is_wider_than_the_terminal(columns: int) -> None:
    lines = text(shift(), columns=columns).splitlines()
    assert max(map(len, lines)) <= columns
    assert any("…" in line for line in lines)


def test_deep_nodes_can_still_be_read() -> None:
    body = "Main: " + "{Inverter: " * 60 + "AlwaysSuccess" + "}" * 60
    lines = text(charted(body), columns=80).splitlines()
    assert [line.strip() for line in lines[-2:]] == ["└── ¬ Inverter", "└── □ AlwaysSuccess"]


def test_long_values_are_shortened_before_short_ones() -> None:
    body = f"Main: {{Log: {{message: {'m' * 80}, value: 12}}}}"
    assert text(charted(body), columns=50).splitlines()[3] == f"└── □ Log  message: {'m' * 18}…  value: 12"


def test_dot_has_a_cluster_for_each_tree_with_its_nodes_and_edges() -> None:
    lines = dot(charted("Main: {ForceSuccess: {do: {Log: {message: 'a \"b\" <c> \\d'}}}}")).splitlines()
    assert lines[0] == 'digraph "mission" {'
    assert [line.split(" [")[0].strip() for line in lines[4:-2]] == [
        'subgraph "cluster Main" {',
        "graph",
        '"Main/ForceSuccess"',
        '"Main/ForceSuccess/Log"',
        '"Main/ForceSuccess" -> "Main/ForceSuccess/Log"',
    ]
    assert 'label="□ Log\\lmessage: a &quot;b&quot; &lt;c&gt; \\\\d\\l"' in lines[7]
    assert 'tooltip="mission.yaml:4"' in lines[7]


def test_graphviz_takes_the_text_without_a_word(tmp_path: Path) -> None:
    for name in ("False", "True"):
        (tmp_path / name).write_text(dot(shift(), expand=name == "True"), encoding="utf-8")
    program = """
import pygraphviz
for name in ("False", "True"):
    graph = pygraphviz.AGraph(name)
    graph.node_attr.update(label="")
    graph.layout(prog="dot")
    print(graph.number_of_nodes())
"""
    ran = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    warnings = [line for line in ran.stderr.splitlines() if "Fontconfig" not in line]
    assert (ran.returncode, warnings) == (0, [])
    assert [int(line) for line in ran.stdout.splitlines()] == [200, written_out(shift(), "Main")]


def written_out(found: Chart, name: str) -> int:
    """Nodes of a tree with a cluster in place of each call."""
    nodes = list(found.tree(name).root.iterate())
    return sum(written_out(found, node.calls) if node.calls else 1 for node in nodes)


def pictures() -> dict[str, str]:
    """Of the shift, in each format."""
    return {
        suffix: drawing_text(chart_of_file(SHIFT), suffix) for suffix in (".svg", ".html", ".dot", ".txt")
    }


def test_a_picture_is_the_same_in_every_process_and_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: OtherProcess
) -> None:
    monkeypatch.chdir(tmp_path)
    assert elsewhere.call(pictures) == pictures()


def test_suffix_of_a_picture() -> None:
    assert suffix_of("a/Tree.SVG") == ".svg"
    with pytest.raises(PicktreeError) as refused:
        suffix_of("tree.pdf")
    assert str(refused.value) == "tree.pdf: a picture is a file that ends in .svg, .html, .dot or .txt"
    assert drawing_text(charted(), ".txt") == text(charted())


def test_the_page_on_pictures_tells_how_to_draw_one() -> None:
    root = Path(__file__).parents[2]
    page = (root / "docs" / "pictures.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    names: dict[str, object] = {"Path": (root / "examples").joinpath}
    exec(program, names)
    assert 'class="node decorator running" data-path="Main/Repeat"' in str(names["picture"])


DESCRIBED = """
Main: {Handle: {item: red_1}}
Handle:
  doc: >
    Take one item, and say so;
    nothing else.
  ports: {item: {type: object, doc: what is taken}}
  Take: {object: "{item}"}
"""


def test_a_tree_is_described_where_it_is_drawn_and_where_it_is_called() -> None:
    drawn = charted(DESCRIBED)
    assert text(drawn).splitlines()[5:8] == [
        "Handle  item: object",
        "Take one item, and say so; nothing else.",
        "└── □ Take  object: {item}",
    ]
    call = drawn.trees[0].root
    assert call.doc == "Take one item, and say so; nothing else. Defined at mission.yaml:5."
    assert f'tooltip="{call.doc}' in dot(drawn)
    page = svg(drawn)
    assert re.search(r'<tspan class="doc"[^>]*>Take one item, and say so;', page)
    assert f"<title>Handle (sub-tree)\n{call.doc}\n" in page
    undescribed = charted("Main: Sub\nSub: AlwaysSuccess").trees[0].root
    assert undescribed.doc == "Defined at mission.yaml:5."


def test_a_sub_tree_of_the_library_names_its_own_file(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("picktree: 1\nkind: mission\ninclude: [library/recovery]\ntrees: {Main: PutDown}\n")
    assert re.fullmatch(
        r"Put what is held down on the table, .* Defined at library/recovery:\d+\.",
        chart_of_file(path).trees[0].root.doc,
    )
