"""Expressions as values of ports, `"{= n + 1}"`, elements of lists, and the mass of an object."""

from __future__ import annotations

import json
from typing import cast

import pytest

from picktree.world import Plain, tree

from .scripted import FakeWorld, Run, letters, start

ITEMS = """
Main:
  Sequence:
    - Find: {ids: [red_cube_1, blue_cube_1], found: "{items}"}
    - %s
"""


def world() -> FakeWorld:
    found = FakeWorld()
    found.put("red_cube_1", "red")
    found.put("blue_cube_1", "blue")
    return found


def failure(run: Run) -> str:
    report = run.tree.root.failure
    assert report is not None and report.cause is tree.MISSING_INPUT
    return report.message


@pytest.mark.parametrize(
    ("node", "taken"),
    [
        ('Take: {object: "{= items[0]}"}', "take red_cube_1  30"),
        ('Take: {object: "{=items[-1]}", force: "{= 4 * len(items) }"}', "take blue_cube_1  8"),
        ('Take: {object: "{items}", force: 1}', None),
        ('Take: {object: x, colour: "{= items[1].colour}"}', "take x blue 30"),
        ("Take: {object: x, hand: \"{= 'right' if len(items) > 1 else 'left'}\"}", "take x  30"),
    ],
)
def test_the_value_is_computed_when_the_node_starts(node: str, taken: str | None) -> None:
    if taken is None:  # a list is no object: the wiring says so
        with pytest.raises(Exception, match=r"port 'object': \{items\} is a list"):
            start(ITEMS % node, world())
        return
    run = start(ITEMS % node, world())
    assert letters(run.to_end()) == "RRS"
    assert run.trace == [taken]


def test_it_is_constant_while_the_node_runs_and_computed_anew_at_the_next_start() -> None:
    run = start(
        """
        Main:
          Sequence:
            - AlwaysSuccess: {_onSuccess: "n := 1"}
            - Repeat:
                num_cycles: 2
                do:
                  Take: {object: x, force: "{= n * 10}", _onSuccess: "n := n + 1"}
        """
    )
    run.tick()
    run.tree.blackboard.write("Main/n", 1, "test")
    assert run.tree.find("Main/Sequence/Repeat/Take").save_state()["inputs"] == {"force": 10.0}
    run.to_end()
    assert run.trace == ["take x  10", "take x  20"]


def test_a_sub_tree_gets_the_value_of_its_start_as_a_key_of_its_own() -> None:
    run = start(
        """
        Main:
          Sequence:
            - AlwaysSuccess: {_onSuccess: "n := 3"}
            - Sub: {force: "{= n + 0.5}", some: "{= ['a', 'b']}"}
        Sub:
          ports: {force: float, some: list of object}
          ForEach: {in: "{some}", out: "{one}", do: {Take: {object: "{one}", force: "{force}"}}}
        """
    )
    assert letters(run.to_end())[-1] == "S"
    assert run.trace == ["take a  3.5", "take b  3.5"]
    assert run.tree.blackboard.save()["Main/Sequence/Sub/force"] == 3.5


def test_a_node_that_follows_its_value_follows_an_expression() -> None:
    run = start(
        'Main: {Switch: {variable: "{= n % 2}", cases: {0: {Answer: {script: R}}, 1: AlwaysSuccess}}}'
    )
    run.tree.blackboard.write("Main/n", 4, "test")
    assert letters([run.tick()]) == "R"
    run.tree.blackboard.write("Main/n", 5, "test")
    assert letters([run.tick()]) == "S"


def test_a_saved_tree_goes_on_with_the_value_of_the_start() -> None:
    wait = '{Delay: {delay_msec: "{= n * 100}", do: AlwaysSuccess}}'
    body = f'Main: {{Sequence: [{{AlwaysSuccess: {{_onSuccess: "n := 2"}}}}, {wait}]}}'
    live, resumed = start(body), start(body)
    live.tick()
    live.tree.blackboard.write("Main/n", 50, "test")
    resumed.tree.restore(cast("dict[str, Plain]", json.loads(json.dumps(live.tree.save()))))
    resumed.world.clock.now = live.world.clock.now
    assert letters(resumed.to_end()) == letters(live.to_end()) == "RRRS"


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ('Take: {object: "{= items[2]}"}', "input 'object' of Take: the expression 'items[2]': a list of 2 "
         "has no element [2]; [0] is the first, [1] the last"),
        ('Take: {object: x, force: "{= 1 / (len(items) - 2)}"}',
         "input 'force' of Take: the expression '1 / (len(items) - 2)': division by zero"),
        ('Take: {object: "{= items[0] if items == [] else null}"}',
         "input 'object' of Take: {= items[0] if items == [] else null} is empty"),
        ("Take: {object: x, hand: \"{= items[0]}\"}",
         "input 'hand' of Take: {= items[0]}: 'red_cube_1' is not a choice; known: left, right"),
        ('Sub: {n: "{= items[3]}"}', "input 'n' of Sub: the expression 'items[3]': a list of 2 has no "
         "element [3]; [0] is the first, [1] the last"),
        ("Take: {object: x, force: \"{= items[0].mass * 100}\"}", "input 'force' of Take: the expression "
         "'items[0].mass * 100': '*' does not work on null and a number"),
    ],
)  # fmt: skip
def test_a_value_that_does_not_exist_or_fit_fails_the_node(node: str, message: str) -> None:
    run = start(ITEMS % node + "\nSub: {ports: {n: any}, AlwaysSuccess: {}}", world())
    assert letters(run.to_end())[-1] == "F"
    assert failure(run) == message


def test_the_mass_is_unknown_until_the_object_is_weighed() -> None:
    body = "Main: {Condition: {if: item.mass == null}}"
    known = world()
    run = start(body, known)
    run.tree.blackboard.write("Main/item", "red_cube_1", "test")
    assert letters([run.tick()]) == "S"
    version = known.scene.version
    known.scene.weighed("red_cube_1", 0.12)
    assert known.scene.version == version
    assert letters([run.tick()]) == "F"
    # What is seen of it afterwards says nothing of its mass.
    known.put("red_cube_1", "red", place="hand")
    assert known.scene.get("red_cube_1").mass == 0.12
