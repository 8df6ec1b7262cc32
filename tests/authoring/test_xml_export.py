"""What stands in the XML that is written, for what BehaviorTree.CPP says otherwise or not at all."""

from __future__ import annotations

from textwrap import dedent, indent

import pytest

from picktree.authoring.xml import mission_to_xml
from picktree.files import FileError

from .btcpp_rules import complaints
from .xml_missions import parsed


def exported(trees: str) -> str:
    xml = mission_to_xml(parsed(f"picktree: 1\nkind: mission\ntrees:\n{indent(dedent(trees), ' ')}"))
    assert complaints(xml) == []
    return xml


def body(trees: str) -> str:
    """The tree `Main`, without indentation."""
    xml = exported(trees)
    return dedent(
        xml[xml.index(">\n", xml.index('<BehaviorTree ID="Main"')) + 2 : xml.index("  </BehaviorTree>")]
    )


def models(trees: str) -> str:
    xml = exported(trees)
    return dedent(xml[xml.index("<TreeNodesModel>\n") + 17 : xml.index("  </TreeNodesModel>")])


LEAF = "{Take: {object: a}}"
WRITES = {
    "a condition that scripts can say": (
        " Main: {Condition: {if: not true or 3 < 4}}",
        '<ScriptCondition code="!true || 3 &lt; 4"/>\n',
    ),
    "a condition that only we can say": (
        " Main: {Condition: {name: more, if: items_left}}",
        '<CheckExpression name="more" if="items_left"/>\n',
    ),
    "conditions that scripts can say": (
        " Main: {AlwaysSuccess: {_skipIf: not true, _onSuccess: 'n := 1; n = n + 1', breakpoint: after}}",
        '<AlwaysSuccess _breakpoint="after" _skipIf="!true" _onSuccess="n := 1; n = n + 1"/>\n',
    ),
    "one condition that only we can say takes the others with it": (
        " Main: {AlwaysSuccess: {_skipIf: not true, _while: items_left}}",
        '<Guarded skip_if="not true" while="items_left">\n  <AlwaysSuccess/>\n</Guarded>\n',
    ),
    "a Repeat with `while`": (
        " Main: {Repeat: {while: items_left, num_cycles: 3, do: AlwaysSuccess}}",
        '<RepeatWhile while="items_left" num_cycles="3">\n  <AlwaysSuccess/>\n</RepeatWhile>\n',
    ),
    "a Repeat without": (
        " Main: {Repeat: {num_cycles: 3, do: AlwaysSuccess}}",
        '<Repeat num_cycles="3">\n  <AlwaysSuccess/>\n</Repeat>\n',
    ),
    "times in whole milliseconds": (
        " Main: {Timeout: {msec: 1.5 s, do: AlwaysSuccess}}",
        '<Timeout msec="1500">\n  <AlwaysSuccess/>\n</Timeout>\n',
    ),
    "quantities in SI": (" Main: {Take: {object: a, force: 500 mN}}", '<Take object="a" force="0.5"/>\n'),
    "assignments": (
        "Main: {Script: {code: \"n := 3; n += 1; t = 'x'\"}}",
        '<Script code="n := 3; n = n + 1; t = \'x\'"/>\n',
    ),
    "assignments that scripts cannot say": (
        'Main: {Script: {name: count, code: "n := len([1, 2])"}}',
        '<AssignExpressions name="count" code="n := len([1, 2])"/>\n',
    ),
    "numbers keep their type in a Script, texts stand in SetBlackboard": (
        " Main: {Sequence: [{SetBlackboard: {value: 3, output_key: '{n}'}}, "
        "{SetBlackboard: {value: three, output_key: '{t}'}}]}",
        '<Sequence>\n  <Script code="n := 3" _sets="true"/>\n'
        '  <SetBlackboard value="three" output_key="t"/>\n</Sequence>\n',
    ),
    "a text that looks like a number": (
        " Main: {SetBlackboard: {value: '3', output_key: '{n}'}}",
        "<Script code=\"n := '3'\" _sets=\"true\"/>\n"
    ),
    "a copy": (
        " Main:\n  ports: {a: any}\n  SetBlackboard: {value: '{a}', output_key: '{n}'}",
        '<SetBlackboard value="{a}" output_key="n"/>\n',
    ),
    "an expression that scripts can say": (
        " Main:\n  ports: {a: {type: int, default: 1}}\n"
        "  SetBlackboard: {name: half, value: '{= a / 2}', output_key: '{n}'}",
        '<Script name="half" code="n := a / 2"/>\n',
    ),
    "a Switch of two cases without a default": (
        " Main: {Switch: {variable: a, cases: {a: AlwaysSuccess, b: AlwaysSuccess}}}",
        '<Switch2 variable="a" case_1="a" case_2="b">\n  <AlwaysSuccess/>\n  <AlwaysSuccess/>\n'
        '  <AlwaysFailure _no_case="true"/>\n</Switch2>\n',
    ),
    "a Recover": (
        f" Main: {{Recover: {{do: {LEAF}, when: {{grasp.missed: AlwaysSuccess, '*': [AlwaysFailure]}}, "
        "give_up: AlwaysSuccess}}",
        '<Recover when="grasp.missed=1; *=2" give_up="3">\n  <Take object="a"/>\n  <AlwaysSuccess/>\n'
        '  <Sequence name="*">\n    <AlwaysFailure/>\n  </Sequence>\n  <AlwaysSuccess/>\n</Recover>\n',
    ),
    "a name that BehaviorTree.CPP would not tell from its own": (
        " Main: {Condition: {name: ScriptCondition, if: true}}",
        '<ScriptCondition _name="ScriptCondition" code="true"/>\n',
    ),
    "what a call leaves out and BehaviorTree.CPP wants": (
        " Main: {Sub: {}}\n Sub:\n  ports: {label: {type: string, default: ''}, "
        "found: {type: list of string, direction: out}}\n  Find: {ids: [], found: '{found}'}",
        '<SubTree ID="Sub" label="" found="{_unused_Sub_found}" _left_out="label found"/>\n',
    ),
    "keys that a call shares, and those of the root": (
        " Main: {Sequence: [{SetBlackboard: {value: x, output_key: '{n}'}}, "
        "{Sub: {_autoremap: true, m: b}}]}\n"
        " Sub: {ports: {m: string}, Log: {message: '{n}', value: '{@n}'}}",
        '<Sequence>\n  <SetBlackboard value="x" output_key="n"/>\n'
        '  <SubTree ID="Sub" _autoremap="true" m="b"/>\n</Sequence>\n',
    ),
    "two calls of the same name": (
        " Main: {Sequence: [{Sub: {name: one}}, {Sub: {name: one}}, Sub]}\n Sub: AlwaysSuccess",
        '<Sequence>\n  <SubTree ID="Sub" name="one"/>\n  <SubTree ID="Sub" name="one (2)" _name="one"/>\n'
        '  <SubTree ID="Sub"/>\n</Sequence>\n',
    ),
    "a name with a character that BehaviorTree.CPP refuses there": (
        ' Main: {AlwaysSuccess: {name: "a\\x7fb"}}', '<AlwaysSuccess name="ab" _name="a\x7fb"/>\n'
    ),
    "numbers of a sub-tree's port, as the types that read them want it": (
        " Main: {Sub: {n: 600, f: 600, t: 600, u: 600, x: 600}}\n Sub:\n"
        "  ports: {n: int, f: float, t: {type: float, unit: ms}, u: float, x: any}\n"
        "  Sequence: [{Repeat: {num_cycles: '{n}', do: AlwaysSuccess}}, {Take: {object: a, force: '{f}'}}, "
        "{Delay: {delay_msec: '{t}', do: AlwaysSuccess}}, {Timeout: {msec: '{u}', do: AlwaysSuccess}}]",
        '<SubTree ID="Sub" n="600" f="600.0" t="600 ms" u="600 " x="600"/>\n',
    ),
    "a list of one number of a sub-tree's port": (
        " Main: {Sub: {l: [1]}}\n Sub: {ports: {l: list of int}, Log: {message: a, value: '{l}'}}",
        '<SubTree ID="Sub" l="json:[1]"/>\n',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITES)
def test_what_is_written(name: str) -> None:
    trees, xml = WRITES[name]
    assert body(trees) == xml


def test_a_switch_of_many_cases_is_btcpp_s_own_class_under_a_name_to_be_registered() -> None:
    cases = ", ".join(f"c{i}: AlwaysSuccess" for i in range(8))
    trees = f" Main: {{Switch: {{variable: c1, cases: {{{cases}}}}}}}"
    assert body(trees).startswith('<Switch8\n    variable="c1"\n    case_1="c0"\n    case_2="c1"\n')
    assert '<Control ID="Switch8">' in models(trees)


def test_ports_of_trees_are_declared_with_all_that_a_mission_says_of_them() -> None:
    assert models(
        """\
         Main:
          ports:
            rounds: {type: int, default: 4, doc: how often & why}
            item: {type: object}
            width: {type: float, unit: m, default: 3 cm}
            side: {type: string, choices: [left, right], default: left}
            seen: {type: list of object, direction: out}
          Find: {ids: [], found: "{seen}"}
        """
    ) == (
        '<SubTree ID="Main">\n'
        '  <input_port name="rounds" type="int" default="4" description="how often &amp; why"/>\n'
        '  <input_port name="item" type="ObjectId"/>\n'
        '  <input_port name="width" type="double" default="0.03" unit="m"/>\n'
        '  <input_port\n      name="side"\n      type="std::string"\n      default="left"\n'
        '      choices="json:[&quot;left&quot;, &quot;right&quot;]"/>\n'
        '  <output_port name="seen" type="std::vector&lt;ObjectId&gt;"/>\n'
        "  <MetadataFields>\n"
        '    <Metadata picktree="1"/>\n'
        "  </MetadataFields>\n"
        "</SubTree>\n"
        '<Action ID="Find">\n'
        '  <input_port name="ids" type="std::vector&lt;std::string&gt;">what it finds</input_port>\n'
        '  <output_port name="found" type="std::vector&lt;ObjectId&gt;">what was found</output_port>\n'
        "</Action>\n"
    )


def test_a_declared_port_gives_way_where_its_type_would_clash() -> None:
    """Of two types of a key only one can be BehaviorTree.CPP's own; the model leaves the other open."""
    trees = (
        " Main:\n  ports: {n: {type: int, default: 1}}\n"
        "  Repeat: {num_cycles: '{n}', do: {Take: {object: a, force: '{n}'}}}"
    )
    assert '<input_port name="force" type="BT::AnyTypeAllowed" default="30">' in models(trees)
    assert '<input_port name="force" type="double" default="30">' in models(trees.replace("'{n}'}}}", "2}}}"))


REFUSED = {
    " Main: ManualSelector\n ManualSelector: AlwaysSuccess": [
        "P920 mission.yaml:5:2: trees.ManualSelector: 'ManualSelector' is a name of BehaviorTree.CPP's own "
        "(give the tree another name)"
    ],
    # BehaviorTree.CPP types a key where it is used first: here by the first call, as a number.
    " Main:\n  ports: {n: {type: int, default: 3}}\n  Sequence: [{Sub: {m: 1}}, {Sub: {m: '{n}'}}]\n"
    " Sub:\n  ports: {m: int}\n  Sequence:\n"
    "   - Switch: {variable: '{m}', cases: {3: AlwaysSuccess}}\n"
    "   - ParallelAll: {max_failures: '{@n}', do: [AlwaysSuccess]}": [
        "P925 mission.yaml:10:25: Sub/Sequence/Switch: port 'variable': {m} is int at another node, and "
        "std::string here (BehaviorTree.CPP wants one type for each key; use two)"
    ],
    " Main: {Sub: {ID: a}}\n Sub: {ports: {ID: object}, Take: {object: '{ID}'}}": [
        "P921 mission.yaml:5:2: trees.Sub: BehaviorTree.CPP keeps the attribute 'ID' for itself "
        "(give the port another name)"
    ],
    " Main: {Log: {message: ' {a b} '}}": [
        "P922 mission.yaml:4:24: Main/Log: port 'message': BehaviorTree.CPP reads ' {a b} ' as a key of the "
        "blackboard (leave out the braces)"
    ],
    " Main: {Timeout: {msec: 0.5, do: AlwaysSuccess}}": [
        "P923 mission.yaml:4:25: Main/Timeout: port 'msec': BehaviorTree.CPP counts whole "
        "milliseconds, not 0.5"
    ],
    ' Main: {Log: {message: "\\a"}}': [
        "P924 mission.yaml:1:1: <Log>: no XML file can hold the character U+0007 (leave it out)"
    ],
    " Main: {Repeat: {num_cycles: 3000000000, do: AlwaysSuccess}}": [
        "P923 mission.yaml:4:30: Main/Repeat: port 'num_cycles': BehaviorTree.CPP counts with 32 bits; "
        "3000000000 is too large"
    ],
    " Main: {Sub: {s: '3'}}\n"
    " Sub: {ports: {s: string}, Switch: {variable: '{s}', cases: {a: AlwaysSuccess}}}": [
        "P926 mission.yaml:4:18: Main/Sub: port 's': BehaviorTree.CPP takes '3' for a number, and a node "
        "reads a text from it (write a text that is no number, or set a key with SetBlackboard and give that)"
    ],
    " Main:\n  ports: {n: {type: int, default: 1}}\n"
    "  Repeat: {num_cycles: '{n}', do: {Timeout: {msec: '{n}', do: AlwaysSuccess}}}": [
        "P925 mission.yaml:6:52: Main/Repeat/Timeout: port 'msec': {n} is int at another node, and unsigned "
        "here (BehaviorTree.CPP wants one type for each key; use two)"
    ],
    " Main: {Take: {object: a, force: '{= 3 * 2}'}}": [
        "P929 mission.yaml:4:34: Main/Take: port 'force': BehaviorTree.CPP has no expressions as values of "
        'ports (set a key with SetBlackboard before this node, and give "{force}" here)'
    ],
    " Main: {SetBlackboard: {value: '{= [1, 2][0]}', output_key: '{n}'}}": [
        "P929 mission.yaml:4:32: Main/SetBlackboard: port 'value': BehaviorTree.CPP has no expressions as "
        'values of ports (set a key with SetBlackboard before this node, and give "{value}" here)'
    ],
    " Main: {Sub: {s: '{= 3}'}}\n Sub: {ports: {s: int}, Repeat: {num_cycles: '{s}', do: AlwaysSuccess}}": [
        "P929 mission.yaml:4:18: Main/Sub: port 's': BehaviorTree.CPP has no expressions as values of ports "
        '(set a key with SetBlackboard before this node, and give "{s}" here)'
    ],
}


@pytest.mark.parametrize("trees", REFUSED)
def test_what_btcpp_could_not_load_is_refused(trees: str) -> None:
    mission = parsed(f"picktree: 1\nkind: mission\ntrees:\n{trees}\n")
    with pytest.raises(FileError) as caught:
        mission_to_xml(mission)
    assert [f"{fault.code} {fault}" for fault in caught.value.faults] == REFUSED[trees]
