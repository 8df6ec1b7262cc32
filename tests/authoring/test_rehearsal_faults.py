"""What can be wrong in a cases file: each fault's whole text, and all of them at once."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent, indent

import pytest

from picktree.authoring.rehearsal import check_cases, rehearse_files
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.files import FileError
from picktree.files.yaml import read_document

from ..trees.rehearsing import faults_of, mission_of, nodes

MISSION = """
Main:
  ports: {pause: {type: float, unit: ms, default: 0}}
  Sequence:
    - Look: {objects: "{items}"}
    - ForEach: {in: "{items}", out: "{item}", do: {SortOne: {item: "{item}"}}}
    - IfThenElse: [Ready, Go]
    - Weigh: {weight: "{w}", sort: "{s}"}
SortOne:
  ports: {item: {type: object}}
  Recover:
    do: [{Pick: {object: "{item}"}}, {Put: {object: "{item}"}}]
    when: {grasp.*: [Go]}
"""
WEIGHED = "Weigh: {outputs: {weight: 1, sort: light}}"


def faults(case: str) -> list[str]:
    """Of one case whose text begins on line 5, each with its place below `leaves`, `expect` or the case."""
    text = "cases:\n  it:\n" + indent(dedent(case).strip(), "    ")
    found = faults_of(text, mission_of(MISSION, "scene: three_bins\n"))
    return [re.sub(r"cases\.it\.(leaves\.|expect\.)?", "", fault, count=1) for fault in found]


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        # Patterns.
        ("Grab: SUCCESS", "P703 6:7: Grab: no node of the mission fits 'Grab' (known: Look, Pick, Put, Go, "
         "Ready, Weigh, Sequence, ForEach, SortOne, Recover, grasp.*, IfThenElse)"),
        ("Main/Recover/Look: SUCCESS", "P703 6:7: Main/Recover/Look: no node of the mission fits "
         "'Main/Recover/Look' ('Look' stands at Main/Sequence/Look)"),
        ("'/': SUCCESS", "P703 6:7: /: the pattern is empty (as SortOne/Grasp)"),
        ("Recover: SUCCESS", "P704 6:7: Recover: 'Recover' is a node of the language (Recover), for which "
         "a case cannot give answers (answer for the leaves below it, or set what it reads by 'facts' or "
         "'objects'; known: Look, Pick, Put, Go, Ready, Weigh)"),
        # Answers.
        ("Pick: 3", "P710 6:13: Pick: an answer is a status, a cause or a mapping, not 3 (as SUCCESS, or "
         "{cause: grasp.missed, ticks: 3})"),
        ("Pick: SUCESS",
         "P710 6:13: Pick: 'SUCESS' is neither a status nor a cause (did you mean 'SUCCESS'?)"),
        ("Pick: []", "P710 6:13: Pick: the list of answers is empty"),
        ("Pick: {else: SUCCESS}", "P105 6:7: Pick: 'answers' is missing"),
        ("Pick: {answers: [SUCCESS], than: SUCCESS}",
         "P104 6:34: Pick.than: unknown key 'than' (known: answers, else)"),
        ("Pick: {answers: SUCCESS}", "P710 6:14: Pick.answers: 'answers' is a list of answers"),
        ("Pick: {cause: grasp.missed, status: SUCCESS}",
         "P710 6:43: Pick.status: an answer with a cause is a FAILURE, not SUCCESS"),
        ("Pick: {message: oh}", "P710 6:14: Pick.message: only a failure with a cause has a message"),
        ("Pick: {status: RUNNING, then: {hand: empty}}",
         "P710 6:31: Pick.then: an answer that never ends has no 'then'"),
        ("Pick: FAILURE", "P710 6:13: Pick.status: Pick is a skill, which fails for a cause (one of "
         "grasp.missed, grasp.slipped, safety.*)"),
        ("Pick: [SUCCESS, SKIPPED]", "P710 6:23: Pick[1].status: Pick is a skill, which does not skip "
         "itself (only its '_skipIf' or '_while' can skip it; a rehearsal checks them, too)"),
        ("Ready: RUNNING", "P710 6:14: Ready.status: Ready is a condition: it is never RUNNING"),
        ("Ready: {ticks: 2}", "P710 6:22: Ready.ticks: Ready is a condition: it takes no ticks"),
        # Causes.
        ("Look: perception.not_found",
         "P706 6:13: Look.cause: Look does not fail with perception.not_found (it declares none)"),
        # Outputs.
        ("Look: {outputs: {object: [a]}}",
         "P707 6:24: Look.outputs.object: Look has no output 'object' (did you mean 'objects'?)"),
        ("Go: {outputs: {x: 1}}", "P707 6:22: Go.outputs.x: Go has no output 'x' (it has none)"),
        ("Look: {outputs: {objects: a}}", "P708 6:33: Look.outputs.objects: output 'objects' of Look: 'a' "
         "is not a list, each an object's id (what is to be done)"),
        ("Look: {outputs: {objects: [a, c]}}", "P717 6:33: Look.outputs.objects: no object 'c' is in the "
         "belief of this case (known: a, table, red_bin, green_bin, blue_bin)"),
        # What follows from an answer.
        ("Go: {then: {hand: b}}", "P717 6:25: Go.then.hand: no object 'b' is in the belief of this case "
         "(known: a, table, red_bin, green_bin, blue_bin)"),
        ("Go: {then: {facts: {holds: true}}}",
         "P711 6:27: Go.then.facts.holds: there is no fact 'holds' (did you mean 'holding'?)"),
        ("Go: {then: {objects: {b: {place: bin}}}}",
         "P712 6:40: Go.then.objects.b.place: there is no place 'bin' (did you mean 'red_bin'?)"),
    ],
)  # fmt: skip
def test_leaves(answer: str, fault: str) -> None:
    assert faults(f"leaves:\n  {answer}\n  {WEIGHED}\nobjects: {{a: {{}}}}\nexpect: {{status: SUCCESS}}") == [
        fault
    ]


@pytest.mark.parametrize(
    ("weigh", "fault"),
    [
        ("SUCCESS", "P709 6:14: Weigh: Weigh succeeds without its output 'weight', used at "
         "Main/Sequence/Weigh (as {outputs: {weight: …}}: what it weighs)"),
        ("{outputs: {weight: 1}}", "P709 6:14: Weigh: Weigh succeeds without its output 'sort', used at "
         "Main/Sequence/Weigh (as {outputs: {sort: …}}: of what sort it is)"),
        ("{outputs: {weight: 1 m, sort: light}}", "P708 6:33: Weigh.outputs.weight: output 'weight' of "
         "Weigh: '1 m' is a length, not a force (as 20 N) (what it weighs)"),
        ("{outputs: {weight: 1, sort: lite}}", "P708 6:42: Weigh.outputs.sort: output 'sort' of Weigh: "
         "'lite' is not a choice; did you mean 'light'? (of what sort it is)"),
    ],
)  # fmt: skip
def test_outputs_that_somebody_reads(weigh: str, fault: str) -> None:
    assert faults(f"leaves:\n  Weigh: {weigh}\nexpect: {{status: SUCCESS}}") == [fault]


def test_only_leaves_that_a_case_reaches_need_an_answer() -> None:
    for leaves in ("{Go: {cause: planning.no_path}}", "{Go: {cause: planning.no_path}, Weigh: SUCCESS}"):
        assert faults(f"leaves: {leaves}\nexpect: {{status: FAILURE}}") == []
    second = "{Weigh: [{outputs: {weight: 1, sort: light}}, SUCCESS]}"
    assert faults(f"leaves: {second}\nexpect: {{status: SUCCESS}}") == []


def test_a_pattern_after_others_that_fit_all_that_it_fits() -> None:
    case = f"leaves:\n  '*': {{outputs: {{}}}}\n  Pick: SUCCESS\n  {WEIGHED}\nexpect: {{status: SUCCESS}}"
    found = [fault for fault in faults(case) if fault.startswith("P716")]
    assert found == [
        "P716 7:7: Pick: 'Pick' is never used: earlier patterns fit all nodes that it fits (put it first)",
        "P716 8:7: Weigh: 'Weigh' is never used: earlier patterns fit all nodes that it fits (put it first)",
    ]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("parameters: {wait: 1}",
         "P713 5:18: parameters.wait: the mission has no parameter 'wait' (known: pause)"),
        ("parameters: {pause: soon}",
         "P713 5:25: parameters.pause: the mission's parameter 'pause': 'soon' is not a time (as 500 ms)"),
        ("objects: {a: {form: cube}}", "P712 5:25: objects.a.form: there is no form 'cube' (known: box, "
         "cylinder, sphere, plate, mesh, unknown)"),
        ("objects: {a: {colour: rde}}",
         "P712 5:27: objects.a.colour: there is no colour 'rde' (did you mean 'red'?)"),
        ("objects: {a: {destination: redbin}}",
         "P712 5:32: objects.a.destination: there is no bin 'redbin' (did you mean 'red_bin'?)"),
        ("facts: {time: 3}", "P711 5:13: facts.time: the time passes by itself, tick by tick (known: "
         "items_left, items_to_do, holding, held_object, stopped, feed_exhausted, items_done)"),
        ("facts: {holding: 1}", "P711 5:22: facts.holding: the fact 'holding' is true or false, not 1"),
        ("facts: {items_to_do: true}",
         "P711 5:26: facts.items_to_do: the fact 'items_to_do' is a whole number, not true"),
    ],
)  # fmt: skip
def test_the_world_of_a_case(line: str, fault: str) -> None:
    assert faults(f"{line}\nleaves: {{{WEIGHED}}}\nexpect: {{status: SUCCESS}}") == [fault]


@pytest.mark.parametrize(
    ("expect", "fault"),
    [
        ("{never: [], handled: [], facts: {}}", "P714 5:5: expect: nothing is expected: this case "
         "cannot fail (as 'expect: {status: SUCCESS}')"),
        ("{facts: {time: true}}", "P711 5:28: facts.time: the fact 'time' is a number, not true"),
        ("{status: SUCCESS, cause: grasp.missed}",
         "P714 5:38: cause: a mission that ends in SUCCESS has no cause"),
        ("{cause: grasp.gone}",
         "P705 5:21: cause: no cause is called 'grasp.gone' (did you mean 'grasp.double'?)"),
        ("{status: RUNNING}", "P714 5:22: status: RUNNING needs 'ticks', the number of ticks after which the "
        "mission "
        "still runs"),
        ("{status: IDLE}",
         "P714 5:22: status: a mission is IDLE only when it was halted (say so with 'halt_after')"),
        ("{order: [Pick, Puts]}",
         "P703 5:28: order[1]: no node of the mission fits 'Puts' (did you mean 'Put'?)"),
        ("{order: [Recover]}", "P704 5:22: order[0]: 'Recover' is a node of the language (Recover), for "
         "which a case cannot give answers (leave it out: 'order' lists skills and conditions; 'handled' and "
         "'never' name any node; known: Look, Pick, Put, Go, Ready, Weigh)"),
        ("{order: [{Pick: missed}]}", "P714 5:29: order[0].Pick: 'missed' is neither an outcome nor a cause "
         "(did you mean 'grasp.missed'?)"),
        ("{order: [{Pick: place.full}]}", "P706 5:29: order[0].Pick: Pick does not fail with place.full (it "
         "declares grasp.missed, grasp.slipped, safety.*)"),
        ("{order: [[Pick]]}", "P714 5:22: order[0]: an entry of 'order' is a leaf, or a leaf and how it "
         "ends (as Grasp, or {Grasp: grasp.missed}, or '...')"),
        ("{handled: [{by: Recover}]}", "P105 5:24: handled[0]: 'cause' is missing"),
        ("{handled: [grasp.lost]}",
         "P705 5:24: handled[0].cause: no cause is called 'grasp.lost' (did you mean 'grasp.*'?)"),
        ("{handled: [{cause: grasp.missed, by: Recovery}]}",
         "P703 5:50: handled[0].by: no node of the mission fits 'Recovery' (did you mean 'Recover'?)"),
        ("{handled: [{cause: grasp.missed, handler: grasp.missed}]}", "P718 5:55: handled[0].handler: the "
         "mission has no handler 'grasp.missed' (did you mean 'grasp.*'?)"),
        ("{blackboard: {itms: []}}",
         "P715 5:27: blackboard.itms: Main has no key 'itms' (did you mean 'items'?)"),
        ("{blackboard: {Sort/item: a}}", "P715 5:27: blackboard.Sort/item: no sub-tree of the mission fits "
         "'Sort' (did you mean 'SortOne'?)"),
    ],
)  # fmt: skip
def test_expectations(expect: str, fault: str) -> None:
    assert faults(f"expect: {expect}\nleaves: {{{WEIGHED}}}") == [fault]


def test_a_halted_mission_may_not_take_less_ticks_than_it_is_given() -> None:
    assert faults(f"halt_after: 9\nexpect: {{ticks: 3}}\nleaves: {{{WEIGHED}}}") == [
        "P714 6:21: ticks: the mission is halted only after 9 ticks, later than that"
    ]


def test_what_holds_for_all_cases_is_reported_once_where_it_stands() -> None:
    text = """\
    objects: {a: {kind: blok}}
    facts: {hold: true}
    parameters: {wait: 1}
    leaves: {Pick: grasp.gone, Weigh: {outputs: {weight: 1, sort: light}}}
    cases:
      one: {expect: {status: SUCCESS}}
      two: {expect: {status: SUCCESS}}
    """
    assert faults_of(text, mission_of(MISSION, "scene: three_bins\n")) == [
        "P712 3:21: objects.a.kind: there is no kind 'blok' (did you mean 'block'?)",
        "P711 4:9: facts.hold: there is no fact 'hold' (did you mean 'holding'?)",
        "P713 5:14: parameters.wait: the mission has no parameter 'wait' (known: pause)",
        "P705 6:16: leaves.Pick.cause: no cause is called 'grasp.gone' (did you mean 'grasp.double'?)",
    ]


def test_faults_of_form_and_of_names_come_in_one_round() -> None:
    text = """\
    casess: {}
    cases:
      1st: {expect: {status: SUCCESS}}
      two:
        objects: {a: {confidence: 3}, b: {kind: blok}}
        leaves:
          Pick: [{ticks: soon}, grasp.gone]
          Weigh: {outputs: {weight: 1, sort: light}}
        expect: {status: WELL, never: [Gone]}
      three: {leaves: {Weigh: {outputs: {weight: 1, sort: light}}}}
    """
    assert faults_of(text, mission_of(MISSION, "scene: three_bins\n")) == [
        "P104 3:1: casess: unknown key 'casess' (did you mean 'cases'?)",
        "P111 5:3: cases.1st: '1st' is not a name (letters, digits and _, not beginning with a digit)",
        "P709 5:3: cases.1st: Main/Sequence/Weigh has no answer, but an output 'weight' that the mission "
        "uses (as {outputs: {weight: …}}: what it weighs)",
        "P107 7:31: cases.two.objects.a.confidence: 3 is more than 1",
        "P712 7:45: cases.two.objects.b.kind: there is no kind 'blok' (did you mean 'block'?)",
        "P106 9:22: cases.two.leaves.Pick[0].ticks: a whole number is wanted, not 'soon'",
        "P705 9:29: cases.two.leaves.Pick[1].cause: no cause is called 'grasp.gone' "
        "(did you mean 'grasp.double'?)",
        "P108 11:22: cases.two.expect.status: 'WELL' is not known here "
        "(known: SUCCESS, FAILURE, SKIPPED, RUNNING, IDLE)",
        "P703 11:36: cases.two.expect.never[0]: no node of the mission fits 'Gone' (did you mean 'Go'?)",
        "P105 12:3: cases.three: 'expect' is missing",
    ]


@pytest.mark.parametrize("cases", ["cases: {}", "cases:", ""])
def test_a_file_without_cases(cases: str) -> None:
    found = faults_of(cases, mission_of("Main: {Go: {}}"))
    assert [one.split(" ", 1)[0] for one in found] == ["P701"]
    assert found[0].endswith("the file has no cases (add 'cases:' with a name for each case)")


def test_an_object_that_appears_on_the_way_is_known() -> None:
    case = """
    leaves:
      Go: {then: {objects: {b: {}, a: null}, hand: HELD}}
      Weigh: perception.stale
    expect: {ticks: 9}
    """
    assert faults(case.replace("HELD", "b")) == []
    assert [fault[:4] for fault in faults(case.replace("HELD", "a"))] == ["P717"]


def test_what_may_go_wrong_depends_on_the_wiring() -> None:
    mission = mission_of("Main: {Sequence: [{Look: {expect: a}}, {Look: {name: around}}]}")
    case = "cases:\n  it:\n    leaves: {PATTERN: perception.not_found}\n    expect: {status: FAILURE}\n"
    assert faults_of(case.replace("PATTERN", "Look"), mission) == []
    assert faults_of(case.replace("PATTERN", "'*'"), mission) == [
        "P706 5:19: cases.it.leaves.*.cause: Look does not fail with perception.not_found (it declares none)"
    ]


def test_more_cases_than_anybody_reads() -> None:
    text = "cases:\n" + "".join(f"  c{n}: {{expect: {{ticks: 1}}}}\n" for n in range(501))
    assert faults_of(text, mission_of("Main: {Go: {}}")) == [
        "P110 3:1: cases: a file may have at most 500 cases, not 501"
    ]


def test_without_a_mission_only_what_every_mission_knows_is_checked() -> None:
    text = """\
    cases:
      it:
        facts: {hold: true}
        leaves: {Whatever: grasp.gone, Other: brewing.too_hot}
        expect: {status: SUCCESS, never: [Nobody]}
    """
    assert faults_of(text, None) == [
        "P702 1:1: the file names no mission: its nodes, causes, outputs, keys and bins are not checked "
        "(as 'mission: ../sorting.yaml')",
        "P711 5:13: cases.it.facts.hold: there is no fact 'hold' (did you mean 'holding'?)",
        "P705 6:24: cases.it.leaves.Whatever.cause: no cause is called 'grasp.gone' "
        "(did you mean 'grasp.double'?)",
    ]


def test_the_mission_beside_the_file_is_the_one_that_counts(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text("picktree: 1\nkind: mission\ntrees: {Main: {Go: {}}}\n")
    (tmp_path / "bad.yaml").write_text("picktree: 1\nkind: mission\ntrees: {Main: {Gone: {}}, A b: Go}\n")
    (tmp_path / "lost.yaml").write_text("picktree: 1\nkind: mission\nscene: no_bins\ntrees: {Main: Go}\n")

    def found(mission: str) -> list[str]:
        text = f"picktree: 1\nkind: cases\nmission: {mission}\ncases: {{it: {{expect: {{never: [Gone]}}}}}}\n"
        document = read_document(tmp_path / "cases.yaml", "cases", text)
        faults = check_cases(document, nodes())
        return [f"{one.code} {one}".replace(f"{tmp_path}/", "") for one in faults]

    assert found("m.yaml") == [
        "P703 cases.yaml:4:31: cases.it.expect.never[0]: no node of the mission fits 'Gone' "
        "(did you mean 'Go'?)"
    ]
    assert found("none.yaml") == [
        "P702 cases.yaml:3:10: mission: the mission cannot be read: none.yaml:1:1: there is no such file "
        "(the path counts from this file's folder)"
    ]
    assert found("bad.yaml")[0].startswith(
        "P702 cases.yaml:3:10: mission: the mission cannot be read: bad.yaml:3:16: Main: unknown node 'Gone'"
    )
    assert found("lost.yaml")[0].startswith(
        "P702 cases.yaml:3:10: mission: the mission's scene cannot be read: "
    )


def test_a_given_mission_is_the_one_that_the_file_names(tmp_path: Path) -> None:
    given = tmp_path / "given.yaml"
    for mission in (given, tmp_path / "other.yaml"):
        mission.write_text("picktree: 1\nkind: mission\ntrees: {Main: {Sleep: {msec: 1}}}\n")
    (tmp_path / "cases").mkdir()
    cases = tmp_path / "cases" / "given.yaml"

    def warnings(mission: str) -> list[str]:
        cases.write_text(
            f"picktree: 1\nkind: cases\nmission: {mission}\ncases: {{it: {{expect: {{status: SUCCESS}}}}}}\n"
        )
        return [f"{one.code} {one.message} ({one.hint})" for one in rehearse_files(given).warnings]

    assert warnings("../given.yaml") == warnings("../cases/../given.yaml") == []
    assert warnings("../other.yaml") == [
        f"P702 the cases are played with {given}, not with this mission (write 'mission: ../given.yaml')"
    ]
    with pytest.raises(FileError, match=r"the mission cannot be read: .*there is no such file"):
        warnings("../none.yaml")


def test_a_given_mission_needs_no_mission_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "cases.yaml"
    file.write_text(
        "picktree: 1\nkind: cases\ncases: {it: {facts: {a: 1, b: 2}, expect: {status: SUCCESS}}}\n"
    )
    found = examine_cases(read_document(file, "cases"), mission_of("Main: {Go: {}}"))
    assert [fault.where for fault in found.errors] == ["cases.it.facts.a", "cases.it.facts.b"]
