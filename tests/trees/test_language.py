"""What a text means: paths and names, sub-trees and their ports, references, expressions, preconditions."""

from __future__ import annotations

import py_trees
import pytest

from picktree.files import PicktreeError
from picktree.trees import NodeStatus
from picktree.trees.references import ATTRIBUTES, Reference

from .scripted import FakeWorld, letters, start

SORT = """
Main:
  Repeat:
    num_cycles: 1
    do:
      Sequence:
        - Find: {ids: [red_1, blue_1], found: "{items}"}
        - ForEach: {in: "{items}", out: "{item}", do: {SortOne: {thing: "{item}"}}}
        - AlwaysSuccess
        - AlwaysSuccess
SortOne:
  ports: {thing: {type: object}}
  Sequence:
    - Take: {object: "{thing}", colour: "{thing.destination}"}
    - {SetBlackboard: {value: "{thing.colour}", output_key: "{last}"}}
"""


def sorting() -> FakeWorld:
    world = FakeWorld()
    world.put("red_1", "red")
    world.put("blue_1", "blue")
    return world


def test_paths_are_names_from_the_root_and_a_second_of_the_same_name_is_numbered() -> None:
    run = start(SORT)
    assert [info.path for info in run.tree.structure()] == [
        "Main",
        "Main/Repeat",
        "Main/Repeat/Sequence",
        "Main/Repeat/Sequence/Find",
        "Main/Repeat/Sequence/ForEach",
        "Main/Repeat/Sequence/ForEach/SortOne",
        "Main/Repeat/Sequence/ForEach/SortOne/Sequence",
        "Main/Repeat/Sequence/ForEach/SortOne/Sequence/Take",
        "Main/Repeat/Sequence/ForEach/SortOne/Sequence/SetBlackboard",
        "Main/Repeat/Sequence/AlwaysSuccess",
        "Main/Repeat/Sequence/AlwaysSuccess#2",
    ]


def test_the_structure_names_parents_children_and_ports_as_the_file_says_them() -> None:
    infos = {info.path: info for info in start(SORT).tree.structure()}
    loop = infos["Main/Repeat/Sequence/ForEach"]
    assert (loop.id, loop.parent) == ("ForEach", "Main/Repeat/Sequence")
    assert loop.children == ("Main/Repeat/Sequence/ForEach/SortOne",)
    assert loop.ports == {"in": "{items}", "out": "{item}"}
    assert infos["Main"].parent == ""


def test_a_list_for_one_child_is_a_sequence_named_after_its_place() -> None:
    run = start(
        """
        Main:
          Switch:
            variable: red
            cases: {red: [AlwaysSuccess, AlwaysSuccess], blue: AlwaysSuccess}
            default: [{Log: {message: other, name: tell}}]
        """
    )
    assert [info.path for info in run.tree.structure()][2:] == [
        "Main/Switch/red",
        "Main/Switch/red/AlwaysSuccess",
        "Main/Switch/red/AlwaysSuccess#2",
        "Main/Switch/AlwaysSuccess",
        "Main/Switch/default",
        "Main/Switch/default/tell",
    ]


def test_a_sub_tree_sees_its_ports_and_has_keys_of_its_own() -> None:
    run = start(SORT, sorting())
    run.to_end()
    assert run.trace == ["take red_1 red_bin 30", "take blue_1 blue_bin 30"]
    assert run.tree.blackboard.save() == {
        "Main/items": ["red_1", "blue_1"],
        "Main/item": "blue_1",
        "Main/Repeat/Sequence/ForEach/SortOne/last": "blue",
    }


def test_writes_are_recorded_with_their_node_as_copies() -> None:
    run = start(SORT, sorting())
    run.tick()
    run.tick()
    writes = [(w.key, w.value, w.node) for w in run.report.writes]
    assert writes == [
        ("Main/items", ["red_1", "blue_1"], "Main/Repeat/Sequence/Find"),
        ("Main/item", "red_1", "Main/Repeat/Sequence/ForEach"),
    ]
    recorded = run.report.writes[0].value
    assert isinstance(recorded, list)
    recorded.clear()
    kept = run.tree.blackboard.read("Main/items")
    assert kept == ["red_1", "blue_1"]
    assert isinstance(kept, list)
    kept.clear()
    assert run.tree.blackboard.read("Main/items") == ["red_1", "blue_1"]


def test_ports_pass_through_sub_trees_both_ways_with_literals_and_defaults() -> None:
    run = start(
        """
        Main:
          Sequence:
            - Outer: {found: "{result}"}
            - Take: {object: "{first}", force: "{result}"}
            - {SetBlackboard: {value: gone, output_key: "{first}"}}
        Outer:
          ports: {found: {type: float, direction: out}, start: {type: object, default: red_1}}
          Sequence:
            - Inner: {out: "{found}", name_of: "{start}", colour: "{start.colour}"}
        Inner:
          ports:
            out: {type: float, direction: out}
            name_of: object
            colour: string
            n: {type: int, default: 7}
          Sequence:
            - Take: {object: "{name_of}", colour: "{colour}"}
            - SetBlackboard: {value: "{n}", output_key: "{out}"}
        """,
        sorting(),
    )
    run.tick()
    run.tree.blackboard.write("Main/first", "blue_1", "test")
    assert letters(run.to_end()) == "RS"
    assert run.trace == ["take red_1 red 30", "take blue_1  7"]


def test_an_attribute_is_read_from_the_belief_of_the_moment() -> None:
    world = sorting()
    run = start(
        """
        Main:
          RetryUntilSuccessful:
            num_attempts: 3
            do: {Condition: {if: "thing.place == 'red_bin' and thing.colour == 'red'"}}
        """,
        world,
    )
    run.tree.blackboard.write("Main/thing", "red_1", "test")
    assert run.tick() is NodeStatus.RUNNING
    world.put("red_1", "red", place="red_bin")
    assert run.tick() is NodeStatus.SUCCESS


@pytest.mark.parametrize(
    ("expression", "cause", "message"),
    [
        ("zzz > 3", "tree.missing_input",
         "the expression 'zzz > 3': unknown name 'zzz'; known: a, thing, time"),
        ("a.kind == ''", "tree.missing_input",
         "the expression 'a.kind == ''': only an object has attributes, so not 'kind' either"),
        ("thing.colour == 'red'", "world.unknown_object", "no object 'red_9' in the planning scene"),
        ("'a' < a", "tree.missing_input",
         "the expression ''a' < a': '<' does not work on a text and a number"),
    ],
)  # fmt: skip
def test_an_expression_without_a_value_is_a_failure_that_says_why(
    expression: str, cause: str, message: str
) -> None:
    run = start(f'Main: {{Condition: {{if: "{expression}"}}}}')
    run.tree.blackboard.write("Main/thing", "red_9", "test")
    run.tree.blackboard.write("Main/a", 3, "test")
    assert run.tick() is NodeStatus.FAILURE
    assert (str(run.failure.cause), run.failure.message) == (cause, message)


def test_keys_of_the_blackboard_come_before_the_facts_of_the_world() -> None:
    run = start("Main: {Condition: {if: holding == 3}}")
    run.world.known["holding"] = 4
    assert run.tick() is NodeStatus.FAILURE
    run.tree.blackboard.write("Main/holding", 3, "test")
    assert run.tick() is NodeStatus.SUCCESS


def test_only_while_is_asked_of_a_running_node_and_halts_it() -> None:
    run = start("Main: {Answer: {name: A, script: RRR, _while: go, _skipIf: stop, _failureIf: stop}}")
    run.world.known.update(go=True, stop=False)
    assert run.tick() is NodeStatus.RUNNING
    run.world.known["stop"] = True
    assert run.tick() is NodeStatus.RUNNING
    run.world.known["go"] = False
    assert run.tick() is NodeStatus.SKIPPED
    assert run.trace == ["A:R", "A:R", "halt A"]


def test_preconditions_are_tried_in_the_order_of_btcpp() -> None:
    run = start("Main: {AlwaysSuccess: {_skipIf: true, _successIf: true, _failureIf: true}}")
    assert letters(run.to_end()) == "F"
    run = start("Main: {AlwaysFailure: {_skipIf: true, _successIf: true}}")
    assert letters(run.to_end()) == "S"


def test_a_precondition_without_a_value_stops_a_running_node_too() -> None:
    run = start("Main: {Scripted: {name: A, script: RRRR, _while: go}}")
    run.world.known["go"] = True
    run.tick()
    del run.world.known["go"]
    assert run.tick() is NodeStatus.FAILURE
    assert run.trace == ["start A", "run A", "leave A"]


def test_the_tools_of_py_trees_work_on_our_trees() -> None:
    run = start("Main: {Sequence: [AlwaysSuccess, {Scripted: {name: arm, script: RR}}, AlwaysSuccess]}")
    ticked = [node.name for node in run.tree.root.tick()]
    assert ticked == ["AlwaysSuccess", "arm", "Sequence", "Main"]
    shown = py_trees.display.unicode_tree(run.tree.root, show_status=True)
    assert "arm" in shown and "AlwaysSuccess#2" in shown
    assert run.tree.root.tip() is run.tree.root
    run.tree.root.stop(py_trees.common.Status.INVALID)
    assert run.trace[-1] == "leave arm"
    assert run.tree.status is NodeStatus.IDLE


def test_log_tells_the_journal() -> None:
    run = start("Main: {Log: {message: found it, value: [1, a]}}")
    run.tick()
    (note,) = run.notes("log")
    assert (note.message, note.node, note.data) == ("found it: [1, 'a']", "Main/Log", {"value": [1, "a"]})
    assert run.report.nodes[-1].message == "found it: [1, 'a']"


PARAMETERS = """
Main:
  ports:
    object: {type: object, doc: which}
    force: {type: float, unit: N, default: 20 N}
    hands: {type: list of string, default: [left]}
    firm: {type: bool, default: false}
  Sequence:
    - Take: {object: "{object}", force: "{force}"}
    - Condition: {if: "firm and hands == ['left', 'right']"}
"""


def test_parameters_are_read_as_in_a_file() -> None:
    run = start(PARAMETERS, object="red_1", force="5 N", hands="left, right", firm="true")
    assert letters(run.to_end()) == "RS"
    assert run.trace == ["take red_1  5"]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "the mission's parameter 'object' needs a value: which"),
        ({"object": "a", "forse": "3"}, "the mission has no parameter 'forse' (did you mean 'force'?)"),
        ({"object": "a", "force": "3 mm"},
         "the mission's parameter 'force': '3 mm' is a length, not a force (as 20 N)"),
        ({"object": "a", "firm": "yes"}, "the mission's parameter 'firm': 'yes' is neither true nor false"),
    ],
)  # fmt: skip
def test_a_parameter_that_does_not_fit_is_refused(parameters: dict[str, str], message: str) -> None:
    with pytest.raises(PicktreeError) as caught:
        start(PARAMETERS, None, **parameters)
    assert str(caught.value) == message


ROOT_KEYS = """
Main: {Sequence: [{SetBlackboard: {value: 3, output_key: "{n}"}}, Sub, {Condition: {if: n == 5 and m == 7}}]}
Sub: {Sequence: [{Script: {code: "@n += 2; @m := 7; n := 0"}}, {Condition: {if: @n == 5 and n == 0}}, Deep]}
Deep: {SetBlackboard: {value: "{@m}", output_key: "{@k}"}}
"""


def test_a_key_of_the_root_is_the_same_in_all_trees() -> None:
    run = start(ROOT_KEYS.replace("if: @n == 5 and n == 0", 'if: "@n == 5 and n == 0"'))
    assert run.tick() is NodeStatus.SUCCESS
    assert run.tree.blackboard.save() == {"Main/n": 5, "Main/m": 7, "Main/k": 7, "Main/Sequence/Sub/n": 0}
    resumed = start("Main: {Sequence: [Sub]}\nSub: {WaitValueUpdate: {entry: '{@n}', do: AlwaysSuccess}}")
    resumed.tree.blackboard.write("Main/n", 1, "test")
    assert resumed.tick() is NodeStatus.SUCCESS
    assert resumed.tick() is NodeStatus.RUNNING
    again = start("Main: {Sequence: [Sub]}\nSub: {WaitValueUpdate: {entry: '{@n}', do: AlwaysSuccess}}")
    again.tree.restore(resumed.tree.save())
    assert again.tick() is NodeStatus.RUNNING, "restored values are no writes"
    again.tree.blackboard.write("Main/n", 1, "test")
    assert again.tick() is NodeStatus.SUCCESS


@pytest.mark.parametrize("text", ["{a}", "{@a}", "{a.colour}", "{@a_1.destination.kind}"])
def test_a_reference_reads_back_as_written(text: str) -> None:
    assert str(Reference.parse(text)) == text


def test_the_whitelist_holds_what_is_plain_of_an_object() -> None:
    assert set(ATTRIBUTES) == {
        "id", "role", "kind", "form", "colour", "sigma_position", "sigma_angle", "confidence", "last_seen",
        "place", "attached", "mass", "size", "destination",
    }  # fmt: skip
