"""Keys that are read before they are written, on some way or on all, and keys that nothing reads."""

from __future__ import annotations

import pytest

from .linting import lint, main

WRITE = 'SetBlackboard: {value: 1, output_key: "{x}"}'
READ = 'Log: {message: a, value: "{x}"}'


def test_a_key_that_nothing_writes_is_an_error_with_the_nearest_name() -> None:
    text = main(
        'Observe: {camera: overhead, objects: "{items}"}',
        'ForEach: {in: "{itmes}", out: "{item}", do: {Log: {message: a, value: "{item}"}}}',
    )
    assert lint(text, "P301") == [
        "P301 5:23 Main/Sequence/ForEach: port 'in': nothing has written 'itmes' when it is read "
        "(did you mean 'items'?)"
    ]
    assert lint(main(READ)) == [
        "P301 4:34 Main/Sequence/Log: port 'value': nothing has written 'x' when it is read "
        "(nothing in Main writes any key)"
    ]


def test_a_key_that_is_written_further_down_is_an_error_and_said_once() -> None:
    assert lint(main(READ, WRITE, READ)) == [
        "P301 4:34 Main/Sequence/Log: port 'value': nothing has written 'x' when it is read "
        "(SetBlackboard, line 7, writes it, further down)"
    ]


def test_an_expression_at_a_port_reads_its_keys() -> None:
    computed = 'Log: {message: a, value: "{= [1, x][0]}"}'
    assert lint(main(computed, WRITE)) == [
        "P301 4:34 Main/Sequence/Log: port 'value': nothing has written 'x' when it is read "
        "(SetBlackboard, line 7, writes it, further down)"
    ]
    assert lint(main(WRITE, computed)) == []
    sub = "  Sub: {ports: {n: int}, Repeat: {num_cycles: '{n}', do: Observe}}\n"
    assert lint(main("Sub: {n: '{= x + 1}'}", WRITE) + sub, "P301", "P302") == [
        "P301 4:18 Main/Sequence/Sub: port 'n': nothing has written 'x' when it is read "
        "(SetBlackboard, line 7, writes it, further down)"
    ]
    assert lint(main(WRITE, "Sub: {n: '{= x + 1}'}") + sub) == []


def test_a_loop_does_not_make_a_read_succeed() -> None:
    text = main(f"Repeat: {{while: items_left, num_cycles: 3, do: {{{READ}}}}}")
    assert lint(text, "P301", "P302") == [
        "P301 4:82 Main/Sequence/Repeat/Log: port 'value': nothing has written 'x' when it is read "
        "(nothing in Main writes any key)"
    ]


def test_a_loop_may_have_written_it_the_time_before() -> None:
    text = main(f"Repeat: {{num_cycles: 3, do: {{Fallback: [{{{READ}}}, {{{WRITE}}}]}}}}")
    assert lint(text) == [
        "P302 4:75 Main/Sequence/Repeat/Fallback/Log: port 'value': perhaps nothing has written 'x' yet "
        "(SetBlackboard, line 6, writes it, further down)"
    ]


@pytest.mark.parametrize(
    "writer",
    [
        "ForceSuccess: {Observe: {camera: overhead, expect: red, objects: '{x}'}}",
        "Fallback: [{Observe: {camera: overhead, expect: red, objects: '{x}'}}, AlwaysSuccess]",
        "IfThenElse: [{Condition: {if: holding}}, {Observe: {objects: '{x}'}}, AlwaysSuccess]",
        "Observe: {objects: '{x}', _skipIf: holding}",
        "ForEach: {in: [1, 2], do: {Observe: {objects: '{x}', _while: holding}}}",
        "Parallel: {success_count: 1, do: [{Delay: {delay_msec: 1 s, do: AlwaysSuccess}}, "
        "{Observe: {objects: '{x}'}}]}",
        "Repeat: {while: holding, do: {Observe: {objects: '{x}'}}}",
    ],
)
def test_a_way_that_passes_the_writer_by(writer: str) -> None:
    (only,) = lint(main(writer, READ), "P301", "P302")
    assert only.startswith("P302 5:34 Main/Sequence/Log: port 'value': perhaps nothing has written 'x' yet (")


@pytest.mark.parametrize(
    "writer",
    [
        WRITE,
        "Log: {message: a, _onSuccess: 'x := 1'}",
        "RunOnce: {SetBlackboard: {value: 1, output_key: '{x}'}}",
        "Fallback: [{Observe: {expect: a, objects: '{x}'}}, {SetBlackboard: {value: 1, output_key: '{x}'}}]",
        "RetryUntilSuccessful: {num_attempts: 3, do: {Observe: {expect: red, objects: '{x}'}}}",
        "Recover: {do: {Observe: {expect: red, objects: '{x}'}}, otherwise: AlwaysSuccess}",
        "ForEach: {in: [1, 2], out: '{x}', do: {ForceSuccess: {GoTo: {pose: home}}}}",
        "Repeat: {num_cycles: 2, do: {Observe: {objects: '{x}'}}}",
        "Parallel: [{Observe: {objects: '{x}'}}, {Delay: {delay_msec: 1 s, do: AlwaysSuccess}}]",
        "ReactiveSequence: [{Condition: {if: not stopped}}, {Observe: {objects: '{x}'}}]",
        "Switch: {variable: a, cases: {a: {SetBlackboard: {value: 1, output_key: '{x}'}}}}",
        "IfThenElse: [{Condition: {if: holding}}, {Observe: {objects: '{x}'}}, "
        "{SetBlackboard: {value: [], output_key: '{x}'}}]",
        "Sequence: {_onFailure: 'x := 1', _onSuccess: 'x := 2', do: [{GoTo: {pose: home}}]}",
        "KeepRunningUntilFailure: {GoTo: {pose: home}}",
    ],
)
def test_every_way_leads_over_a_writer(writer: str) -> None:
    assert lint(main(writer, READ), "P301", "P302") == []


def test_beside_the_writer_in_a_parallel() -> None:
    text = "trees:\n  Main:\n    Parallel:\n      - %s\n      - Log: {message: a, value: '{x}'}"
    (finding,) = lint(text % "Observe: {objects: '{x}'}", "P302")
    assert finding.startswith(
        "P302 5:34 Main/Parallel/Log: port 'value': perhaps nothing has written 'x' yet"
    )
    # What ends at once has ended before the next child is ticked.
    assert lint(text % "SetBlackboard: {value: 1, output_key: '{x}'}", "P302") == []


def test_an_expression_reads_its_names_and_facts_are_always_there() -> None:
    late = "SetBlackboard: {value: 1, output_key: '{n}'}"
    assert lint(main("Condition: {if: holding and n > 3}", late)) == [
        "P301 4:25 Main/Sequence/Condition: port 'if': nothing has written 'n' when it is read "
        "(SetBlackboard, line 7, writes it, further down)"
    ]
    found = lint(main("Log: {message: a, _skipIf: n > 3, _onSuccess: 'n = 1'}", late), "P301")
    assert [finding.split(": nothing")[0] for finding in found] == ["P301 4:36 Main/Sequence/Log: _skipIf"]
    assert lint(main("Condition: {if: items_left and not holding or time > 3}")) == []


def test_the_ports_of_a_sub_tree_are_for_its_user_to_see_to() -> None:
    text = """
    trees:
      Main:
        Sequence:
          - Show: {what: "{thing}"}
          - Show: {what: 3}
          - SetBlackboard: {value: 1, output_key: "{thing}"}
          - Show: {what: "{thing}"}
      Show:
        ports: {what: any}
        Inner: {what: "{what}"}
      Inner:
        ports: {what: any}
        Log: {message: a, value: "{what}"}
    """
    assert lint(text) == [
        "P301 4:22 Main/Sequence/Show: port 'what': nothing has written 'thing' when it is read "
        "(SetBlackboard, line 8, writes it, further down)"
    ]


def test_what_a_sub_tree_writes_reaches_its_user_as_far_as_it_is_written() -> None:
    text = """
    trees:
      Main:
        Sequence:
          - Look: {found: "{items}"}
          - ForEach: {in: "{items}", out: "{item}", do: {Log: {message: a, value: "{item}"}}}
      Look:
        ports: {found: {type: list of object, direction: out}}
        Fallback:
          - Observe: {camera: overhead, expect: red, objects: "{found}"}
          - %s
    """
    assert lint(text % "Log: {message: not seen}", "P301", "P302") == [
        "P302 5:23 Main/Sequence/ForEach: port 'in': perhaps nothing has written 'items' yet "
        "(Look, line 6, writes it, but may fail or be skipped)"
    ]
    assert lint(text % 'SetBlackboard: {value: [], output_key: "{found}"}', "P301", "P302") == []


def test_a_sub_tree_keeps_its_own_keys_from_one_use_to_the_next() -> None:
    text = """
    trees:
      Main:
        Repeat: {num_cycles: 3, do: Count}
      Count:
        Sequence:
          - RunOnce: {SetBlackboard: {value: 1, output_key: "{n}"}}
          - Log: {message: a, value: "{n}"}
    """
    assert lint(text, "P301", "P302") == []
    text = """
    trees:
      Main:
        Repeat: {num_cycles: 3, do: Count}
      Count:
        Sequence:
          - Fallback:
              - Log: {message: a, value: "{n}"}
              - SetBlackboard: {value: 1, output_key: "{n}"}
    """
    (finding,) = lint(text, "P301", "P302")
    assert finding.startswith("P302 7:38 Count/Sequence/Fallback/Log: port 'value': perhaps")


def test_an_output_that_nothing_reads() -> None:
    assert lint(main("Observe: {objects: '{items}'}")) == [
        "P303 4:28 Main/Sequence/Observe: objects: 'items' is written, and nothing in Main reads it "
        "(leave out an output that no node needs)"
    ]
    assert lint(main("Log: {message: a, _onSuccess: 'n := 1'}")) == [
        "P303 4:39 Main/Sequence/Log: _onSuccess: 'n' is written, and nothing in Main reads it "
        "(leave out an output that no node needs)"
    ]


@pytest.mark.parametrize(
    "reader",
    [
        "ForEach: {in: '{x}', do: AlwaysSuccess}",
        "Condition: {if: len(x) > 3}",
        "AlwaysSuccess: {_skipIf: len(x) > 3}",
        "Log: {message: a, _onSuccess: 'x := x'}",
        "Show: {what: '{x}'}",
    ],
)
def test_an_output_that_something_reads(reader: str) -> None:
    show = '  Show:\n    ports: {what: any}\n    Log: {message: a, value: "{what}"}'
    show = show if "Show" in reader else ""
    assert lint(main("Observe: {objects: '{x}'}", reader) + show, "P303") == []


def test_an_output_of_the_tree_is_read_outside() -> None:
    text = """
    trees:
      Main:
        Sequence: [{Look: {found: "{x}"}}, {Log: {message: a, value: "{x}"}}]
      Look:
        ports: {found: {type: list of object, direction: out}}
        Observe: {objects: "{found}"}
    """
    assert lint(text) == []
    assert lint(text.replace(', {Log: {message: a, value: "{x}"}}', "")) == [
        "P303 3:31 Main/Sequence/Look: found: 'x' is written, and nothing in Main reads it "
        "(leave out an output that no node needs)"
    ]


def test_keys_of_the_root_are_written_somewhere_in_the_mission() -> None:
    text = """
    trees:
      Main:
        Sequence: [Write, {Log: {message: a, value: "{n}"}}, {Log: {message: a, value: "{m}"}}]
      Write:
        Script: {code: "@n := 1; @m := @n"}
    """
    assert lint(text) == []
    with pytest.raises(AssertionError, match="unknown name '@q'"):
        lint(text.replace("@m := @n", "@m := @q"))


def test_an_output_of_a_tree_that_reads_it_is_read_by_the_call() -> None:
    text = """
    trees:
      Main:
        Sequence:
          - Script: {code: "total := 0"}
          - Outer: {n: "{total}"}
      Outer: {ports: {n: {type: any, direction: out}}, Sequence: [Inner: {m: "{n}"}]}
      Inner: {ports: {m: {type: any, direction: out}}, Script: {code: "m %s 1"}}
    """
    assert lint(text % "+=") == []
    assert [finding[:9] for finding in lint(text % ":=")] == ["P303 4:24"]


SHARING = """
trees:
  Main:
    Sequence:
      - SetBlackboard: {value: 1, output_key: "{n}"}
      - Count: {_autoremap: true}
      - Count: {_autoremap: true}
  Count:
    Sequence:
      - Script: {code: "n += 1; seen := n"}
      - Condition: {if: seen < limit}
"""


def test_a_call_that_shares_its_keys_hands_on_those_that_are_written() -> None:
    assert lint(SHARING, "P301") == [
        "P301 5:9 Main/Sequence/Count: port 'limit': nothing has written 'limit' when it is read "
        "(known: n, seen)"
    ]
    written = SHARING.replace('"{n}"}', '"{n}"}\n      - SetBlackboard: {value: 9, output_key: "{limit}"}', 1)
    assert lint(written) == []
    said = "trees.Main: Count reads the key 'limit' of its caller, which this call does not share"
    with pytest.raises(AssertionError, match=said):
        lint(written.replace("{_autoremap: true}", "{}", 1))


def test_a_change_of_a_key_that_nothing_wrote_is_told_how_to_write_it() -> None:
    for code in ("tries = 0", "tries += 1"):
        (finding,) = lint(main(f"Script: {{code: '{code}'}}"), "P301")
        assert finding.endswith(
            "('tries := …' writes a key for the first time, '=' and '+=' only change one)"
        )


def test_no_fact_and_no_input_is_proposed_for_a_key_that_nothing_reads() -> None:
    use = "Sequence: [{Observe: {objects: '{items}'}}, {Condition: {if: items_left and item != null}}]"
    (finding,) = lint(f"trees: {{Main: {{ports: {{item: object}}, {use}}}}}", "P303")
    assert finding.endswith("(leave out an output that no node needs)")
