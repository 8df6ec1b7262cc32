"""What flows over keys and ports: each thing that does not fit is said where it arrives, with its writer."""

from __future__ import annotations

from textwrap import dedent

import pytest

from picktree.files import FileError
from picktree.robot import World
from picktree.trees import ConditionNode, In, Out, Skill, Steps, port
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import ObjectId

from ..effort import counted
from .scripted import FILE, NODES


class Measure(Skill):
    """Gives values of all types."""

    count: Out[int] = port("a whole number")
    width: Out[float] = port("a length", unit="m")
    sure: Out[bool] = port("a flag")
    side: Out[str] = port("a side", choices=("left", "right"))
    word: Out[str] = port("a text")
    one: Out[ObjectId] = port("an object")
    all: Out[list[ObjectId]] = port("objects")
    numbers: Out[list[float]] = port("numbers")
    thing: Out[object] = port("anything")

    def run(self, world: World) -> Steps:
        yield


class Use(ConditionNode):
    """Takes values of all types."""

    count: In[int] = port("a whole number", default=1, least=1, most=9)
    length: In[float] = port("a length", unit="m", default=0.0)
    force: In[float] = port("a force", unit="N", default=0.0)
    flag: In[bool] = port("a flag", default=False)
    side: In[str] = port("a side", default="left", choices=("left", "right"))
    colour: In[str] = port("a colour", default="", choices=("red", "beige"))
    text: In[str] = port("a text", default="")
    one: In[ObjectId] = port("an object", default=ObjectId(""))
    into: In[ObjectId] = port("a bin", default=ObjectId(""), names="bin")
    all: In[list[ObjectId]] = port("objects", default=[])
    maybe: In[str | None] = port("a text or nothing", default=None)
    thing: In[object] = port("anything", default=None)

    def answer(self, world: World) -> bool:
        return True


MEASURE = (
    "Measure: {count: '{n}', width: '{w}', sure: '{f}', side: '{s}', word: '{t}', one: '{o}', all: '{os}', "
    "numbers: '{xs}', thing: '{what}'}"
)


def faults(text: str) -> list[str]:
    try:
        parse_mission(
            "picktree: 1\nkind: mission\n" + dedent(text).lstrip("\n"),
            FILE,
            NodeRegistry((*NODES, Measure, Use), installed=False),
        )
    except FileError as error:
        return [f"{fault.code} {str(fault).removeprefix('mission.yaml:')}" for fault in error.faults]
    return []


def after_measure(node: str) -> list[str]:
    """The faults of a node that comes after `Measure`, which stands on line 6."""
    return faults(f"trees:\n  Main:\n    Sequence:\n      - {MEASURE}\n      - {node}\n")


@pytest.mark.parametrize(
    "wired",
    [
        "count: '{n}'", "length: '{n}'", "length: '{w}'", "flag: '{f}'", "side: '{s}'", "text: '{t}'",
        "text: '{o}'", "one: '{o}'", "into: '{o.destination}'", "into: '{o}'", "all: '{os}'", "maybe: '{t}'",
        "colour: '{o.colour}'", "text: '{o.kind}'", "length: '{o.sigma_position}'", "flag: '{o.attached}'",
        "one: '{o.id}'", "count: '{what}'", "all: '{what}'", "one: '{what.id}'", "thing: '{xs}'",
        "thing: '{f}'", "text: '{nobody}'", "text: '{o.destination}'", "one: '{t2}', _skipIf: 'n > 3'",
        "count: '{= n + 1}'", "length: '{= w * 2}'", "one: '{= os[0]}'", "all: '{= [o, os[n]]}'",
        "flag: '{= n > 3}'", "side: '{= s if f else ''left''}'", "text: '{= o.kind}'", "maybe: '{= null}'",
        "count: '{= what[0]}'", "colour: '{= os[-1].colour}'", "into: '{= os[0].destination}'",
    ],
)  # fmt: skip
def test_what_fits_is_quiet(wired: str) -> None:
    assert after_measure(f"Use: {{{wired}}}") == []


@pytest.mark.parametrize(
    ("wired", "fault"),
    [
        ("count: '{w}'", "P237 7:22: port 'count': {w} is a number, not a whole number (Measure)"),
        ("length: '{t}'", "P237 7:23: port 'length': {t} is a text, not a number (Measure)"),
        ("flag: '{n}'", "P237 7:21: port 'flag': {n} is a whole number, not true or false (Measure)"),
        ("text: '{n}'", "P237 7:21: port 'text': {n} is a whole number, not a text (Measure; join it to a "
         "text, as \"{= 'text ' + n}\")"),
        ("one: '{t}'", "P237 7:20: port 'one': {t} is a text, not an object's id (Measure)"),
        ("one: '{os}'",
         "P237 7:20: port 'one': {os} is a list, each an object's id, not an object's id (Measure; "
         'one of it is "{= os[0]}", and ForEach takes all in turn)'),
        ("one: '{o.colour}'", "P237 7:20: port 'one': {o.colour} is a text, not an object's id (Measure)"),
        ("one: '{o.destination}'",
         "P237 7:20: port 'one': {o.destination} is the name of a place, not an object's id (Measure)"),
        ("all: '{o}'",
         "P237 7:20: port 'all': {o} is an object's id, not a list, each an object's id (Measure)"),
        ("all: '{xs}'",
         "P237 7:20: port 'all': {xs} is a list, each a number, not a list, each an object's id (Measure)"),
        ("force: '{w}'", "P237 7:22: port 'force': {w} is in m, not in N (Measure)"),
        ("colour: '{s}'",
         "P237 7:23: port 'colour': {s}: 'left' is not a choice; known: red, beige (Measure)"),
        ("text: '{n.colour}'", "P238 7:21: port 'text': {n.colour}: only an object has attributes, and 'n' "
         "is a whole number (Measure)"),
        ("text: '{o.destination.colour}'", "P238 7:21: port 'text': {o.destination.colour}: only an object "
         "has attributes, and 'destination' is the name of a place"),
        ("_skipIf: 'n > t'", "P226 7:27: _skipIf: '>' does not work on a whole number and a text"),
        ("_skipIf: 'm > 3'", "P227 7:25: _skipIf: unknown name 'm'; known: n, w, f, s, t, o, os, xs, what, "
         "items_left, items_to_do, holding, held_object, stopped, feed_exhausted, items_done, time"),
        ("_skipIf: 'items_left > 3'", "P226 7:36: _skipIf: '>' does not work on true/false and a whole "
         "number (items_left is true/false)"),
        ("_skipIf: 'holding == 4'",
         "P226 7:33: _skipIf: true/false and 4 are never equal (holding is true/false)"),
        ("_while: 'item_left'", "P227 7:24: _while: unknown name 'item_left'; did you mean 'items_left'?"),
        ("_post: 'a := 1; b := a - s'",
         "P226 7:38: _post: 'b': '-' does not work on a whole number and a text"),
        ("count: '{= n / 2}'", "P237 7:22: port 'count': {= n / 2} is a number, not a whole number (round "
         'it, as "{= round(n / 2)}")'),
        ("one: '{= os}'", "P237 7:20: port 'one': {= os} is a list, each an object's id, not an object's id "
         '(one of it is "{= os[0]}", and ForEach takes all in turn)'),
        ("side: \"{= 'up' if f else 'down'}\"", "P237 7:21: port 'side': {= 'up' if f else 'down'}: 'up' is "
         "not a choice; known: left, right"),
        ("count: '{= n - t}'", "P226 7:28: port 'count': '-' does not work on a whole number and a text"),
        ("text: '{= t[0]}'", "P226 7:26: port 'text': only a list has elements, and this is a text"),
        ("text: '{= [s][1]}'", "P226 7:28: port 'text': a list of 1 has no element [1]; [0] is the only one"),
        ("count: '{= n + }'", "P225 7:28: port 'count': not an expression: a value is missing after '+'"),
        ("count: '{=}'", "P225 7:25: port 'count': the expression is empty"),
        ("count: '{n + 1}'", "P221 7:22: port 'count': '{n + 1}' is not a reference (an expression begins "
         "with '=': \"{= n + 1}\")"),
        ("length: '{= 3 mm}'", "P225 7:29: port 'length': not an expression: numbers are written without "
         "units here, in SI; leave out 'mm'"),
        ("_skipIf: \"o.colour == 'rde'\"", "P226 7:37: _skipIf: this is never 'rde'; did you mean 'red'?"),
        ("_skipIf: 'o.colour == ''rde'''", "P226 7:24: _skipIf: this is never 'rde'; did you mean 'red'?, "
         "at character 13 of \"o.colour == 'rde'\""),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_said_where_it_arrives(wired: str, fault: str) -> None:
    (found,) = after_measure(f"Use: {{{wired}}}")
    found = found.replace("Main/Sequence/Use: ", "", 1)
    assert found.replace("(Main/Sequence/Measure writes it, line 6", "(Measure") == fault


def test_a_literal_keeps_its_value_on_the_way() -> None:
    assert faults(
        """
        trees:
          Main:
            Sequence:
              - {SetBlackboard: {value: 12, output_key: "{n}"}}
              - {SetBlackboard: {value: rihgt, output_key: "{side}"}}
              - {SetBlackboard: {value: "{n}", output_key: "{again}"}}
              - {SetBlackboard: {value: 30 mm, output_key: "{w}"}}
              - Use: {count: "{again}", side: "{side}", length: "{w}", one: "{side}", text: "{side}"}
        """
    ) == [
        "P237 10:22: Main/Sequence/Use: port 'count': {again}: 12 is more than 9 "
        "(Main/Sequence/SetBlackboard#3 writes it, line 8)",
        "P237 10:39: Main/Sequence/Use: port 'side': {side}: 'rihgt' is not a choice; did you mean "
        "'right'? (Main/Sequence/SetBlackboard#2 writes it, line 7)",
        "P237 10:57: Main/Sequence/Use: port 'length': {w} is a text, not a number "
        "(Main/Sequence/SetBlackboard#4 writes it, line 9)",
    ]


def test_one_of_several_writers_is_enough() -> None:
    assert faults(
        """
        trees:
          Main:
            Sequence:
              - {SetBlackboard: {value: 1, output_key: "{a}"}}
              - AlwaysSuccess: {_onSuccess: "a := 'one'"}
              - Use: {count: "{a}"}
        """
    ) == [
        "P237 8:22: Main/Sequence/Use: port 'count': {a} is a text, not a whole number "
        "(Main/Sequence/AlwaysSuccess writes it, line 7)"
    ]


def test_for_each_gives_the_elements_of_its_list() -> None:
    assert faults(
        f"""
        trees:
          Main:
            Sequence:
              - {MEASURE}
              - ForEach: {{in: "{{os}}", out: "{{x}}", do: {{Use: {{one: "{{x}}", text: "{{x.colour}}"}}}}}}
              - ForEach: {{in: "{{xs}}", out: "{{y}}", do: {{Use: {{one: "{{y}}"}}}}}}
              - ForEach: {{in: [1, 20], out: "{{z}}", do: {{Use: {{count: "{{z}}"}}}}}}
              - ForEach: {{in: [[1], [2]], out: "{{l}}", do: {{ForEach: {{in: "{{l}}", out: "{{e}}",
                  do: {{Use: {{count: "{{e}}", flag: "{{e}}"}}}}}}}}}}
              - ForEach: {{in: "{{n}}", out: "{{u}}", do: AlwaysSuccess}}
        """
    ) == [
        "P237 8:59: Main/Sequence/ForEach#2/Use: port 'one': {y} is a number, not an object's id "
        "(Main/Sequence/ForEach#2 writes it, line 8)",
        "P237 9:62: Main/Sequence/ForEach#3/Use: port 'count': {z}: 20 is more than 9 "
        "(Main/Sequence/ForEach#3 writes it, line 9)",
        "P237 11:42: Main/Sequence/ForEach#4/ForEach/Use: port 'flag': {e} is a whole number, not true or "
        "false (Main/Sequence/ForEach#4/ForEach writes it, line 10)",
        "P237 12:23: Main/Sequence/ForEach#5: port 'in': {n} is a whole number, not a list "
        "(Main/Sequence/Measure writes it, line 6)",
    ]


def test_values_flow_through_the_ports_of_sub_trees() -> None:
    assert faults(
        """
        trees:
          Main:
            Sequence:
              - Inner: {side: rihgt, count: 3, made: "{m}", guess: "{g}"}
              - Inner: {side: left, list: [left, up], made: "{m}"}
              - Use: {count: "{m}", length: "{g}"}
          Outer: {ports: {what: any}, Inner: {side: "{what}"}}
          Again: {Outer: {what: 7}}
          Inner:
            ports:
              side: {type: any}
              count: {type: int, default: 30}
              list: {type: list of string, default: []}
              made: {type: string, direction: out}
              guess: {direction: out}
            Sequence:
              - Use: {side: "{side}", count: "{count}"}
              - ForEach: {in: "{list}", out: "{each}", do: {Use: {side: "{each}"}}}
              - {SetBlackboard: {value: 1, output_key: "{made}"}}
              - {SetBlackboard: {value: word, output_key: "{guess}"}}
        """
    ) == [
        "P237 6:23: Main/Sequence/Inner: port 'side': 'rihgt' is not a choice; did you mean 'right'? "
        "(the value goes to the port 'side' of Use, line 19)",
        "P237 7:9: Main/Sequence/Inner#2: port 'count': its default: 30 is more than 9 "
        "(the value goes to the port 'count' of Use, line 19)",
        "P237 7:35: Main/Sequence/Inner#2: port 'list': 'up' is not a choice; known: left, right "
        "(the value goes to the port 'side' of Use, line 20)",
        "P237 8:22: Main/Sequence/Use: port 'count': {m} is a text, not a whole number "
        "(Main/Sequence/Inner writes it, line 6)",
        "P237 8:37: Main/Sequence/Use: port 'length': {g} is a text, not a number "
        "(Main/Sequence/Inner writes it, line 6)",
        "P237 9:31: Outer/Inner: port 'count': its default: 30 is more than 9 "
        "(the value goes to the port 'count' of Use, line 19)",
        "P237 10:25: Again/Outer: port 'what': 7 is a whole number, not a text "
        "(the value goes to the port 'side' of Use, line 19)",
        "P237 21:48: Inner/Sequence/SetBlackboard: port 'output_key': what it writes is a whole number, "
        "not a text (the tree's output 'made', line 16)",
    ]


def test_what_is_wrong_inside_a_sub_tree_is_said_there_only() -> None:
    assert faults(
        """
        trees:
          Main: {Sequence: [{Sub: {p: x}}, {Sub: {p: y}}, {Outer: {q: z}}]}
          Outer: {ports: {q: string}, Sub: {p: "{q}"}}
          Sub: {ports: {p: string}, Timeout: {msec: "{p}", do: AlwaysSuccess}}
        """
    ) == [
        "P237 6:45: Sub/Timeout: port 'msec': {p} is a text, not a number (the tree's input 'p', line 6)",
    ]


def test_units_are_kept_over_the_ports_of_sub_trees() -> None:
    assert faults(
        """
        trees:
          Main:
            ports: {pause: {type: float, unit: s, default: 2 s}}
            Timeout: {msec: "{pause}", do: AlwaysSuccess}
        """
    ) == [
        "P237 6:21: Main/Timeout: port 'msec': {pause} is in s, not in ms (the tree's input 'pause', line 5)"
    ]


def test_an_input_of_a_tree_is_not_written_inside() -> None:
    assert faults(
        """
        trees:
          Main: {Sub: {n: 1, item: a}}
          Sub:
            ports: {n: int, item: object}
            ForEach: {in: [1], out: "{item}", do: {AlwaysSuccess: {_post: "n := n + 1"}}}
        """
    ) == [
        "P239 7:29: Sub/ForEach: port 'out': 'item' is an input of the tree 'Sub'; it cannot be written "
        "(declare the port with 'direction: out', or write another key)",
        "P239 7:67: Sub/ForEach/AlwaysSuccess: _post: 'n' is an input of the tree 'Sub'; it cannot be "
        "written (declare the port with 'direction: out', or write another key)",
    ]


def test_a_key_does_not_hide_a_fact() -> None:
    assert faults(
        """
        trees:
          Main: {Sequence: [{Measure: {count: "{time}"}}, {Sub: {holding: true}}]}
          Sub: {ports: {holding: bool}, AlwaysSuccess: {_post: "stopped := 1"}}
        """
    ) == [
        "P259 4:39: Main/Sequence/Measure: port 'count': the key 'time' hides the fact of that name in "
        "expressions (give it another name)",
        "P259 5:26: Sub: the key 'holding' hides the fact of that name in expressions (give it another name)",
        "P259 5:56: Sub/AlwaysSuccess: _post: the key 'stopped' hides the fact of that name in expressions "
        "(give it another name)",
    ]


def test_cases_that_the_value_is_never() -> None:
    assert faults(
        f"""
        trees:
          Main:
            Sequence:
              - {MEASURE}
              - Switch: {{variable: "{{f}}", cases: {{true: AlwaysSuccess, yes: AlwaysSuccess}}}}
              - Switch: {{variable: "{{n}}", cases: {{1: Sub, 1.5: Sub, red: Sub}}}}
              - Switch: {{variable: "{{s}}", cases: {{left: AlwaysSuccess, rihgt: AlwaysSuccess}}}}
              - Switch: {{variable: "{{o.colour}}", cases: {{red: AlwaysSuccess, rde: AlwaysSuccess}}}}
              - Switch: {{variable: "{{os}}", cases: {{red: AlwaysSuccess}}}}
              - Switch: {{variable: "{{what}}", cases: {{red: AlwaysSuccess, 1: AlwaysSuccess}}}}
          Sub: AlwaysSuccess
        """
    ) == [
        "P258 7:64: Main/Sequence/Switch: {f} is never 'yes': it is true/false "
        "(Main/Sequence/Measure writes it, line 6)",
        "P258 8:51: Main/Sequence/Switch#2: {n} is never '1.5': it is a whole number "
        "(Main/Sequence/Measure writes it, line 6)",
        "P258 8:61: Main/Sequence/Switch#2: {n} is never 'red': it is a whole number "
        "(Main/Sequence/Measure writes it, line 6)",
        "P258 9:64: Main/Sequence/Switch#3: {s} is never 'rihgt' (did you mean 'right'?)",
        "P258 10:70: Main/Sequence/Switch#4: {o.colour} is never 'rde' (did you mean 'red'?)",
        "P258 11:44: Main/Sequence/Switch#5: {os} is never 'red': it is a list, each an object's id "
        "(Main/Sequence/Measure writes it, line 6)",
    ]


def test_keys_that_feed_each_other_are_not_followed_for_ever() -> None:
    assert faults(
        """
        trees:
          Main:
            Sequence:
              - {SetBlackboard: {value: "{b}", output_key: "{a}"}}
              - {SetBlackboard: {value: "{a}", output_key: "{b}"}}
              - AlwaysSuccess: {_post: "n := n + 1; m := k; k := m"}
              - Use: {count: "{a}", text: "{k}", flag: "{n}"}
              - Condition: {if: n == 'one'}
        """
    ) == [
        "P237 9:48: Main/Sequence/Use: port 'flag': {n} is a number, not true or false "
        "(Main/Sequence/AlwaysSuccess writes it, line 8)",
        "P226 10:27: Main/Sequence/Condition: port 'if': a number and a text are never equal",
    ]


def test_a_name_that_may_be_written_by_what_cannot_be_read_is_not_missed() -> None:
    assert faults("trees: {Main: {Sequence: [{Mesure: {count: '{n}'}}, {Condition: {if: n > 3}}]}}") == [
        "P207 3:28: Main/Sequence: unknown node 'Mesure' (did you mean 'Measure'?)"
    ]


def test_long_chains_and_many_writers_cost_little() -> None:
    def copy(value: object, key: str) -> str:
        return f"      - {{SetBlackboard: {{value: {value}, output_key: '{{{key}}}'}}}}\n"

    chain = "".join(copy(f"'{{k{n + 1}}}'", f"k{n}") for n in range(250))
    many = "".join(f"{copy(n, 'm')}      - {{Log: {{message: a, value: '{{m}}'}}}}\n" for n in range(250))
    text = f"trees:\n  Main:\n    Sequence:\n{chain}{many}"
    found, calls = counted(lambda: faults(text))
    assert found == []
    assert calls < 850_000


# Comparisons at inputs of any type: what a call gives can never equal what it is compared with.

MISSION = """
    trees:
      Main:
        ports: {p: {type: any, default: 3}, t: string}
        Sequence:
          - Script: {code: "k := 2.5; m := 1; m := 'a'"}
          - CALL
      Outer: {ports: {v: any}, Check: {slot: "{v}"}}
      Check:
        ports: {slot: {type: any, default: null}, other: {type: any, default: null}}
        Condition: {if: TEST}
    """


def found(call: str, test: str) -> list[str]:
    return faults(MISSION.replace("CALL", call).replace("TEST", test))


@pytest.mark.parametrize(
    ("call", "test", "said"),
    [
        ("Check: {slot: '3'}", "slot == 3", "a text and a whole number are never equal "
         "('slot' is a text, line 8)"),
        ("Check: {slot: 3}", "not '3' == slot", "a text and a whole number are never equal "
         "('slot' is a whole number, line 8)"),
        ("Check: {slot: '{k}'}", "slot == 'a'", "a number and a text are never equal "
         "('slot' is a number, Main/Sequence/Script writes it, line 7)"),
        ("Check: {slot: '{t}'}", "slot == 3", "a text and a whole number are never equal "
         "('slot' is a text, the tree's input 't', line 5)"),
        ("Check: {slot: '{= 1 + 2}'}", "slot == 'a' or other == 1",
         "a whole number and a text are never equal "
         "('slot' is a whole number, line 8)"),
        ("Outer: {v: true}", "not (slot == 'a')", "true/false and a text are never equal "
         "('slot' is true/false, line 8)"),
    ],
)  # fmt: skip
def test_a_comparison_that_fails_with_what_a_call_gives(call: str, test: str, said: str) -> None:
    (fault,) = found(call, test)
    place, message = fault.split(": port 'if': ")
    assert (place[:8], message) == ("P226 12:", said)


@pytest.mark.parametrize(
    ("call", "test"),
    [
        ("Check: {slot: '3'}", "slot == '3'"),
        ("Check: {slot: 3}", "slot == 2.5 or slot == true"),
        ("Check: {slot: null}", "slot == 'a'"),
        ("Check: {}", "slot == 'a'"),
        ("Check: {slot: '{m}'}", "slot == 'a'"),  # with either type
        ("Check: {slot: '{p}'}", "slot == 'a'"),  # a parameter, which may be set
        ("Check: {slot: 3, other: 1}", "other == 1 or slot == 'a'"),  # not evaluated
        ("Check: {slot: 3, other: 1}", "(slot == 'a' if other == 2 else true)"),
    ],
)
def test_a_comparison_that_may_be_made(call: str, test: str) -> None:
    assert found(call, test) == []
