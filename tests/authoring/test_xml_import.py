"""Files of Groot2 and BehaviorTree.CPP 4 as missions: what they become, and how the others are refused."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from picktree.files import FileError

from ..effort import counted
from .xml_missions import registry, xml_to_mission

HERE = Path("tree.xml")
HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">\n'


def imported(xml: str) -> str:
    """What stands under `trees:`."""
    text = xml_to_mission(xml, HERE, registry())
    return text.partition("trees:\n")[2]


def one(body: str) -> str:
    """A file with one tree, whose root stands on line 3."""
    inside = "\n".join(f"    {line}" for line in dedent(body).strip().splitlines())
    return f'{HEAD}  <BehaviorTree ID="Main">\n{inside}\n  </BehaviorTree>\n</root>\n'


def refused(xml: str, path: Path = HERE) -> list[str]:
    with pytest.raises(FileError) as caught:
        xml_to_mission(xml, path, registry())
    return [f"{fault.code} {fault}".replace(f"{path}:", "") for fault in caught.value.faults]


# What becomes what.

BECOMES = {
    "one assignment of a constant": (
        '<Script code="n := -3" _sets="true"/>', '  Main: {SetBlackboard: {value: -3, output_key: "{n}"}}\n'
    ),
    "the explicit form": (
        '<Control ID="Sequence"><Action ID="Take" object="red_1"/></Control>',
        "  Main: {Sequence: [{Take: {object: red_1}}]}\n",
    ),
    "a name that only repeats the ID is none": (
        '<Sequence name="Sequence"><AlwaysSuccess name="here"/></Sequence>',
        "  Main: {Sequence: [{AlwaysSuccess: {name: here}}]}\n",
    ),
    "a condition": (
        '<ScriptCondition code="!holding || 2 &lt; 3"/>', "  Main: {Condition: {if: not holding or 2 < 3}}\n"
    ),
    "a copy": (
        "<Sequence><Script code=\"a := 'x'\" _sets='true'/><Script code='b := a' _sets='true'/></Sequence>",
        '  Main:\n    Sequence:\n      - SetBlackboard: {value: x, output_key: "{a}"}\n'
        '      - SetBlackboard: {value: "{a}", output_key: "{b}"}\n',
    ),
    "several assignments": (
        '<Script code="n := 3; n += 1"/>',
        '  Main: {Script: {code: "n := 3; n = n + 1"}}\n',
    ),
    "a key without braces": (
        '<WasEntryUpdated entry="n"/>',
        '  Main: {WasEntryUpdated: {entry: "{n}"}}\n',
    ),
    "SetBlackboard": (
        '<SetBlackboard value="4" output_key="n"/>',
        '  Main: {SetBlackboard: {value: 4, output_key: "{n}"}}\n',
    ),
    "a Precondition": (
        '<Precondition if="1 &gt; 2" else="SKIPPED"><Take object="a"/></Precondition>',
        "  Main: {Take: {_skipIf: not 1 > 2, object: a}}\n",
    ),
    "a Precondition that fails by default": (
        '<Precondition if="!(1 &gt; 2)"><Take object="a"/></Precondition>',
        '  Main: {Take: {_failureIf: "1 > 2", object: a}}\n',
    ),
    "a Precondition over a node with conditions of its own": (
        '<Precondition if="true"><AlwaysSuccess _skipIf="false"/></Precondition>',
        "  Main:\n    Sequence: {_failureIf: not true, do: [{AlwaysSuccess: {_skipIf: false}}]}\n",
    ),
    "a Precondition with a name": (
        '<Precondition name="gate" if="true"><AlwaysSuccess/></Precondition>',
        "  Main:\n    Sequence: {name: gate, do: [{AlwaysSuccess: {_failureIf: not true}}]}\n",
    ),
    "a loop": (
        '<LoopInt queue="1;2" value="{n}"><AlwaysSuccess/></LoopInt>',
        '  Main: {ForEach: {in: [1, 2], out: "{n}", do: AlwaysSuccess}}\n',
    ),
    "a loop that is skipped at its end": (
        '<LoopInt queue="1;2" value="{n}" if_empty="SKIPPED"><AlwaysSuccess/></LoopInt>',
        '  Main:\n    IfThenElse:\n      - ForEach: {in: [1, 2], out: "{n}", do: AlwaysSuccess}\n'
        "      - AlwaysSuccess: {_skipIf: true}\n",
    ),
    "a loop that fails at its end": (
        '<LoopInt queue="1;2" value="{n}" if_empty="FAILURE"><AlwaysSuccess/></LoopInt>',
        '  Main: {ForceFailure: {ForEach: {in: [1, 2], out: "{n}", do: AlwaysSuccess}}}\n',
    ),
    "a TryCatch and an AsyncSequence": (
        '<TryCatch catch_on_halt="true"><AsyncSequence><AlwaysSuccess/></AsyncSequence>'
        "<AlwaysFailure/></TryCatch>",
        "  Main:\n    TryCatch:\n      catch_on_halt: true\n      do:\n"
        "        - AsyncSequence: [AlwaysSuccess]\n        - AlwaysFailure\n",
    ),
    "numbers, texts and lists by the types of the ports": (
        '<Sequence>\n  <Take object="12" force="20" colour="true"/>\n  <Find ids="a;b" found="{found}"/>\n'
        '  <Log message="1" value="json:{&quot;a&quot;: [1]}"/>\n</Sequence>',
        '  Main:\n    Sequence:\n      - Take: {object: "12", force: 20, colour: "true"}\n'
        '      - Find: {ids: [a, b], found: "{found}"}\n      - Log: {message: "1", value: {a: [1]}}\n',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BECOMES)
def test_what_btcpp_says_in_its_own_way(name: str) -> None:
    xml, trees = BECOMES[name]
    assert imported(one(xml)) == trees


def test_ports_of_sub_trees_are_those_that_callers_give() -> None:
    trees = imported(
        """<root BTCPP_format="4" main_tree_to_execute="Start">
             <BehaviorTree ID="Start">
               <Sequence>
                 <Find ids="a" found="{things}"/>
                 <SubTree ID="TakeOne" thing="b" found="{more}" name="first"/>
                 <SubTree ID="Every" _autoremap="true"/>
               </Sequence>
             </BehaviorTree>
             <BehaviorTree ID="TakeOne">
               <Sequence><Take object="{thing}"/><Find ids="c" found="{found}"/></Sequence>
             </BehaviorTree>
             <BehaviorTree ID="Every">
               <ForEach in="{things}" out="{_one}"><Take object="{_one}"/></ForEach>
             </BehaviorTree>
           </root>"""
    )
    assert trees == (
        "  Main:\n"
        "    Sequence:\n"
        '      - Find: {ids: [a], found: "{things}"}\n'
        '      - TakeOne: {name: first, thing: b, found: "{more}"}\n'
        "      - Every: {_autoremap: true}\n"
        "\n"
        "  TakeOne:\n"
        "    ports: {thing: {type: any}, found: {type: any, direction: out}}\n"
        "    Sequence:\n"
        '      - Take: {object: "{thing}"}\n'
        '      - Find: {ids: [c], found: "{found}"}\n'
        "\n"
        "  Every:\n"
        '    ForEach: {in: "{things}", out: "{_one}", do: {Take: {object: "{_one}"}}}\n'
    )


def test_a_model_says_types_defaults_and_keys_of_the_caller() -> None:
    trees = imported(
        """<root BTCPP_format="4" main_tree_to_execute="Main">
             <BehaviorTree ID="Main">
               <Sequence><SetBlackboard value="a" output_key="seen"/><SubTree ID="Sub"/></Sequence>
             </BehaviorTree>
             <BehaviorTree ID="Sub"><Take object="{what}" force="{force}"/></BehaviorTree>
             <TreeNodesModel>
               <SubTree ID="Sub">
                 <input_port name="what" type="Some::Type" default="{seen}">what to look at</input_port>
                 <input_port name="force" type="double" default="5" description="how hard"/>
               </SubTree>
             </TreeNodesModel>
           </root>"""
    )
    assert '- Sub: {what: "{seen}"}' in trees
    assert "what: {type: any, doc: what to look at}" in trees
    assert "force: {type: float, default: 5, doc: how hard}" in trees


def test_included_files_become_one_mission(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "more.xml").write_text(
        '<root BTCPP_format="4"><include path="../last.xml"/>'
        '<BehaviorTree ID="More"><SubTree ID="Last"/></BehaviorTree></root>'
    )
    (tmp_path / "last.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Last"><AlwaysSuccess/></BehaviorTree></root>'
    )
    main = (
        '<root BTCPP_format="4" main_tree_to_execute="First"><include path="parts/more.xml"/>'
        '<BehaviorTree ID="First"><SubTree ID="More"/></BehaviorTree></root>'
    )
    text = xml_to_mission(main, tmp_path / "main.xml", registry())
    assert text == (
        "picktree: 1\nkind: mission\ntrees:\n  Last: AlwaysSuccess\n\n  More: Last\n\n  Main: More\n"
    )


# What is refused.

REFUSED = {
    "an unknown node, an unknown port, a wrong child count, all at once": (
        one(
            """
            <Sequence>
              <Tkae object="red_1"/>
              <Take objekt="red_1" force="3"/>
              <Inverter/>
              <Take object="red_1" _skipif="true"/>
              <AlwaysSuccess _skipIf="a &amp; b"/>
              <SubTree ID="Sbu"/>
            </Sequence>
            """
        ),
        [
            "P906 4:7: Main/Sequence/Tkae: unknown node 'Tkae' (did you mean 'Take'?)",
            "P908 5:21: Main/Sequence/Take: Take has no port 'objekt' (did you mean 'object'?)",
            "P909 6:7: Main/Sequence/Inverter: Inverter has 0 children; it takes 1",
            "P908 7:37: Main/Sequence/Take: the attribute '_skipif' has no meaning for a run "
            "(did you mean '_skipIf'?)",
            "P910 8:31: Main/Sequence/AlwaysSuccess: _skipIf: bitwise operators have no counterpart, "
            "at character 3 of 'a & b'",
            "P913 9:20: Main/Sequence/Sbu: there is no tree 'Sbu' "
            "(known: Main; give its file or folder, too, or take it for a node with --stubs)",
        ],
    ),
    "what the language finds has its place in the XML, too": (
        one('<Sequence>\n  <Take force="much"/>\n</Sequence>'),
        [
            "P219 4:7: Main/Sequence/Take: port 'object' is missing: what to take",
            "P220 4:20: Main/Sequence/Take: port 'force': 'much' is not a force (as 20 N) (grip force)",
        ],
    ),
    "format 3": (
        '<root main_tree_to_execute="Main"><BehaviorTree ID="Main"><SequenceStar/></BehaviorTree></root>',
        [
            "P904 1:1: root: BTCPP_format=\"4\" is missing (SequenceStar on line 1 is of format 3; this "
            "reads the files of BehaviorTree.CPP 4 and Groot2; convert older ones there)"
        ],
    ),
    "another kind of XML": (
        "<html><body/></html>",
        ["P904 1:1: the first element is <root>, not <html> (as <root BTCPP_format=\"4\">)"],
    ),
    "nodes of BT.CPP that have no counterpart": (
        one('<Sequence><UnsetBlackboard key="a"/></Sequence>'),
        [
            "P907 3:15: Main/Sequence/UnsetBlackboard: 'UnsetBlackboard' has no counterpart (a key cannot be "
            "taken away; write null with SetBlackboard)",
        ],
    ),
    "a Switch with too few children": (
        one('<Switch2 variable="a" case_1="1" case_2="1"><AlwaysSuccess/><AlwaysSuccess/></Switch2>'),
        [
            "P909 3:5: Main/Switch2: Switch2 has 2 children; it takes 3",
            "P911 3:46: Main/Switch2: the case '1' is given twice",
        ],
    ),
    "a table that does not fit": (
        one('<Recover when="grasp.*=1; *=1"><AlwaysSuccess/><AlwaysSuccess/></Recover>'),
        ["P915 3:5: Main/Recover: the child 1 is named twice (children are counted from 0)"],
    ),
    "a table that is none": (
        one('<Recover when="grasp.*"><AlwaysSuccess/></Recover>'),
        ["P915 3:20: Main/Recover: 'when': 'grasp.*' is not 'label=child' (as 'grasp.*=1; control.*=2')"],
    ),
    "no first tree": (
        '<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'
        '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree></root>',
        [
            "P914 1:1: root: which of the 2 trees is the first one? "
            '(as <root BTCPP_format="4" main_tree_to_execute="A">, or `picktree convert --main A`; '
            "no other tree calls 'A', 'B')"
        ],
    ),
    "a tree that is given twice": (
        '<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>\n'
        '<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>',
        ["P905 2:19: A: the tree 'A' is given twice (first at 1:24)"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_is_said_with_its_place(name: str) -> None:
    xml, faults = REFUSED[name]
    assert refused(xml) == faults


def test_a_file_that_includes_itself(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    text = f'{HEAD}<include path="a.xml"/><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
    path.write_text(text)
    assert refused(text, path) == ["P912 2:16: root: the files include each other in a circle: a.xml → a.xml"]


# Hostile files.

LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
HOSTILE = {
    "a billion laughs": (
        f'<!DOCTYPE root [<!ENTITY l0 "ha">{LAUGHS}]><root>&l9;</root>',
        "P902 1:1: a DOCTYPE is not read: it could declare entities (leave it out)",
    ),
    "an external entity": (
        '<!DOCTYPE root [<!ENTITY x SYSTEM "file:///etc/passwd">]><root>&x;</root>',
        "P902 1:1: a DOCTYPE is not read: it could declare entities (leave it out)",
    ),
    "an external DTD": (
        '<!DOCTYPE root SYSTEM "http://127.0.0.1/a.dtd"><root/>',
        "P902 1:1: a DOCTYPE is not read: it could declare entities (leave it out)",
    ),
    "depth": ("<a>" * 100_000, "P903 1:301: the elements are nested more than 100 deep"),
    "breadth": ("<a>" + "<b/>" * 30_000 + "</a>", "P903 1:80000: the file has more than 20000 elements"),
    "size": (f'<a b="{"x" * 4_000_001}"/>', "P903 1:1: the file is larger than 4 MB"),
    "many attributes": (
        "<a " + " ".join(f'b{i}=""' for i in range(100_000)) + ">",
        "P903 1:1: an element has more than 1000 attributes",
    ),
    "a byte 0": (
        "<root>\0</root>",
        "P901 1:7: not valid XML: this is not allowed here (in values write &lt; for < and &amp; for &)",
    ),
    "half a character": (
        "<root>\ud800</root>",
        "P901 1:7: not valid XML: this is not allowed here (in values write &lt; for < and &amp; for &)",
    ),
    "nothing": ("", 'P901 1:1: not valid XML: the file is empty (it begins with <root BTCPP_format="4">)'),
    "a nesting of JSON": (
        one(f'<Log message="" value="json:{"[" * 100_000}"/>'),
        "P911 3:28: Main/Log: 'value': not valid JSON behind 'json:': maximum recursion depth exceeded while "
        "decoding a JSON array from a unicode string",
    ),
    "a script without end": (
        one(f'<ScriptCondition code="{"(" * 3000}"/>'),
        "P910 3:28: Main/ScriptCondition: code: the script is nested more than 40 deep, at character 42 of "
        f"'{'(' * 60}'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_with_bounded_effort(name: str) -> None:
    text, fault = HOSTILE[name]
    found, calls = counted(lambda: refused(text))
    assert found == [fault]
    assert calls < 1_000_000
