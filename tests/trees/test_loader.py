"""The loader: the whole text of what it says, place included, and that it says all of it at once."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from picktree.files import FileError
from picktree.trees.loading import load_mission, parse_mission

from .scripted import FILE, mission, registry

HEAD = "picktree: 1\nkind: mission\n"


def faults(text: str) -> list[str]:
    with pytest.raises(FileError) as caught:
        parse_mission(HEAD + dedent(text).lstrip("\n"), FILE, registry())
    assert str(caught.value) == "\n".join(map(str, caught.value.faults))
    return [str(fault).removeprefix("mission.yaml:") for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("trees: {Main: Take}", "3:15: Main/Take: port 'object' is missing: what to take"),
        ("trees: {Main: {SubTree: {ID: Pick, item: a}}, Pick: {ports: {item: object}, AlwaysSuccess: {}}}",
         "3:16: Main: unknown node 'SubTree' (a tree is used by its name: write 'Pick: {item: …}')"),
        ("trees: {Main: {Take: {object: red_1, colour: 3}}}",
         "3:46: Main/Take: port 'colour': 3 is not a text; write it in quotes (its colour)"),
        ("trees: {Main: {Take: {object: red_1, hand: rihgt}}}",
         "3:44: Main/Take: port 'hand': 'rihgt' is not a choice; did you mean 'right'? (which hand)"),
        (f"trees: {{Main: {{Repeat: {{num_cycles: {10**30}, do: AlwaysSuccess}}}}}}",
         "3:37: Main/Repeat: port 'num_cycles': the number is too large (number of cycles; -1 for no limit)"),
        ("trees: {Main: {SetBlackboard: {value: [1, .nan], output_key: '{a}'}}}",
         "3:39: Main/SetBlackboard: port 'value': nan is not a finite number (the value, or a reference "
         "to an entry)"),
        ("trees: {Main: {Find: {ids: red_1, found: '{x}'}}}",
         "3:28: Main/Find: port 'ids': 'red_1' is not a list, each a text (write [red_1])"),
        ("trees: {Main: {Take: {object: '{the item}'}}}", "3:31: Main/Take: port 'object': '{the item}' is "
         'not a reference (a reference is "{key}" or "{key.attribute}")'),
        ("trees: {Main: {Find: {ids: [], found: '{a.id}'}}}",
         "3:39: Main/Find: port 'found' is an output: {a.id} cannot be written"),
        ("trees: {Main: {AlwaysSuccess: {_skipIf: 'f(3)'}}}",
         "3:42: Main/AlwaysSuccess: _skipIf: there is no function 'f'; known: len, min, max, abs, round"),
        ("trees: {Main: {IfThenElse: [AlwaysSuccess, AlwaysSuccess, AlwaysSuccess, AlwaysSuccess]}}",
         "3:28: Main/IfThenElse: IfThenElse has 4 children; it takes 2 to 3"),
        ("trees: {Main: {Sequence: []}}",
         "3:26: Main/Sequence: Sequence has 0 children; it takes at least 1"),
        ("trees: {Main: {Parallel: {success_count: 1}}}",
         "3:16: Main/Parallel: its children are missing: the steps that run at the same time"),
        ("trees: {Main: Inverter}", "3:15: Main/Inverter: its child is missing: the child"),
        ("trees: {Main: {Inverter: []}}",
         "3:26: Main/Inverter: the list is empty; at least one node is needed here"),
        ("trees: {Main: {AlwaysSuccess: [AlwaysFailure]}}",
         "3:31: Main/AlwaysSuccess: AlwaysSuccess has no children"),
        ("trees: {Main: {AlwaysSuccess: 3}}",
         "3:31: Main/AlwaysSuccess: the ports of AlwaysSuccess are a mapping (as '{port: value}')"),
        ("trees:\n  Main:\n    Sequence:\n      - Take: {object: a}\n        force: 3",
         "6:9: Main/Sequence: a node is a mapping with one key, its ID; here are 2: 'Take', 'force' (what "
         "belongs to 'Take' is indented under it)"),
        ("trees: {Main: {Sequence: [3]}}",
         "3:27: Main/Sequence: a node is needed here (as 'Grasp: {object: \"{item}\"}' or a bare ID)"),
        ("trees: {Main: {AlwaysSuccess: {name: a/b}}}",
         "3:38: Main/AlwaysSuccess: a name is a text without '/' and '#', 60 characters at most"),
        ("trees: {Main: {Switch: {variable: 1, cases: []}}}",
         "3:45: Main/Switch: 'cases' is a mapping: child for each value"),
        ("trees: {Main: {Switch: {variable: 1}}}",
         "3:16: Main/Switch: 'cases' is missing: child for each value"),
        ("name: x", "1:1: 'trees:' is missing ('trees:' holds 'Main:' and the sub-trees)"),
        ("trees: {Main: {ports: {}}}", "3:9: trees.Main: the tree 'Main' has no node"),
        ("trees: {Main: AlwaysSuccess, sort one: AlwaysSuccess}",
         "3:30: trees.sort one: 'sort one' is not an ID (a letter or '_', then letters, digits and '_')"),
        ("trees: {Main: Sub, Sub: {ports: {item: {type: object, doc: which}}, AlwaysSuccess: {}}}",
         "3:15: Main/Sub: port 'item' is missing: which"),
        ("trees: {Main: {Sub: {n: a}}, Sub: {ports: {n: {type: int}}, AlwaysSuccess: {}}}",
         "3:25: Main/Sub: port 'n': 'a' is not a whole number"),
        ("trees: {Main: A, A: {Sequence: [AlwaysSuccess, B]}, B: {Inverter: A}}",
         "3:48: trees.A: the sub-trees call each other in a circle: A → B → A (a loop is Repeat or "
         "ForEach)"),
        ("tress: {}\ntrees: {Main: AlwaysSuccess}",
         "3:1: tress: a mission has no key 'tress' (did you mean 'trees'?)"),
        ("goal: sortde == 4\ntrees: {Main: AlwaysSuccess}",
         "3:7: goal: a goal cannot use 'sortde' (did you mean 'sorted'?)"),
        ("goal: sorted == total and left == 'none'\ntrees: {Main: AlwaysSuccess}",
         "3:32: goal: a whole number and a text are never equal"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(text: str, fault: str) -> None:
    assert faults(text) == [fault]


def test_all_faults_of_a_file_are_reported_at_once() -> None:
    text = """
    goal: "1 +"
    scene: [a]
    trees:
      Main:
        Sequence:
          - Tkae: {object: a}
          - Take: {objct: a, force: 3 mm}
          - Nowhere: [{Take: {}}, {Inverter: {Alwaysfailure: {}}}]
          - Sub: {x: 1}
      Sub:
        ports: {y: {type: nothing}}
        Repeat: {do: Tak}
    """
    assert faults(text) == [
        "3:10: goal: not an expression: a value is missing after '+'",
        "4:8: scene: 'scene' is a text",
        "8:9: Main/Sequence: unknown node 'Tkae' (did you mean 'Take'?)",
        "9:9: Main/Sequence/Take: port 'object' is missing: what to take",
        "9:16: Main/Sequence/Take: Take has no port 'objct' (did you mean 'object'?)",
        "9:33: Main/Sequence/Take: port 'force': '3 mm' is a length, not a force (as 20 N) (grip force)",
        "10:9: Main/Sequence: unknown node 'Nowhere' (did you mean 'Answer'?)",
        "10:20: Main/Sequence/Nowhere/Take: port 'object' is missing: what to take",
        "10:43: Main/Sequence/Nowhere/Inverter: unknown node 'Alwaysfailure' (did you mean 'AlwaysFailure'?)",
        "11:15: Main/Sequence/Sub: Sub has no port 'x' (known: y, name, breakpoint)",
        "13:23: trees.Sub.ports.y.type: unknown type 'nothing' (did you mean 'string'?)",
        "14:5: Sub/Repeat: one of 'num_cycles' and 'while' must be given, or the loop would never end",
        "14:18: Sub/Repeat: unknown node 'Tak' (did you mean 'Take'?)",
    ]


def test_a_mission_says_what_the_file_says(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(
        HEAD
        + dedent(
            """
            name: a test
            scene: three_bins
            goal: sorted == total
            trees:
              Main:
                ports: {force: {type: float, unit: N, default: 20 N, doc: how firmly}}
                Sub: {item: red_1, force: "{force}"}
              Sub:
                ports: {item: object, force: float}
                Take: {object: "{item}", force: "{force}", name: first}
            """
        )
    )
    read = load_mission(file, registry())
    assert (read.name, read.scene, str(read.goal)) == ("a test", "three_bins", "sorted == total")
    assert [(p.key, str(p.type), p.default, p.doc) for p in read.parameters] == [
        ("force", "float", 20.0, "how firmly")
    ]
    (take,) = read.trees["Sub"].root.iterate()
    assert (take.id, take.name, str(take.ports["object"])) == ("Take", "first", "{item}")
    assert (take.mark.line, take.mark.column) == (13, 5)


def test_the_name_of_a_mission_is_the_file_s_unless_given() -> None:
    assert mission("Main: AlwaysSuccess").name == "mission"


def test_sub_trees_that_multiply_are_refused_before_they_are_built() -> None:
    trees = "".join(f"  T{n}: {{Sequence: [T{n + 1}, T{n + 1}, T{n + 1}]}}\n" for n in range(12))
    text = f"trees:\n  Main: T0\n{trees}  T12: AlwaysSuccess\n"
    (fault,) = faults(text)
    assert fault.startswith("4:3: trees.Main: with its sub-trees written out the mission has ")
    assert fault.endswith("deep (at most 10000 nodes, 120 deep)")
