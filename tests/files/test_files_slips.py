"""Typing slips: each is one fault at its place, with what is meant; what is meant is read on."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.apps.cli.file_schemas import CHECKS
from picktree.authoring.editor import document_faults
from picktree.files import FileError
from picktree.files.file_checks import UnsavedText, check_files
from picktree.files.quantities import units_like
from picktree.files.quantity_hints import suggest_quantity, suggested
from picktree.files.yaml import read

HEAD = "picktree: 1\nkind: mission\nscene: sort_small\ntrees:\n"
NBSP, THIN, ZERO_WIDTH = "\u00a0", "\u2009", "\u200b"


def faults(body: str) -> list[str]:
    """Return the faults of a mission; its lines count from the first of `body`."""
    report = check_files([UnsavedText(Path("m.yaml"), (HEAD + body).encode())], CHECKS)
    return [
        f"{f.code} {f.mark.line - 4}:{f.mark.column} {f.message}" + (f" ({f.hint})" if f.hint else "")
        for f in report.faults
    ]


def no_blank(name: str) -> str:
    return f"the {name} is no blank in YAML"


BLANK = "write a blank, or put a text with it in quotes"
LEAVE_OUT = "leave it out, or put a text with it in quotes"


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        # Curly quotes.
        (" Main: {Observe: {objects: ‘{items}’, camera: overhead}, X: 1}",
         'P127 1:28 curly quotes are letters in YAML (write "{items}")'),
        (" Main:\n  Log:\n   message: „fertig“",
         'P127 3:13 curly quotes are letters in YAML (write "fertig")'),
        (" Main:\n  “GoTo”: {pose: home}", 'P127 2:3 curly quotes are letters in YAML (write "GoTo")'),
        (' Main: {Log: {message: "all, done”}}',
         'P127 1:24 one of the two quotes is a curly one (write "all, done")'),
        # Other blanks.
        (f" Main: {{GoTo: {{pose: home{THIN}}}}}",
         f"P127 1:26 {no_blank('thin space U+2009')} ({BLANK})"),
        (f" Main: {{Go{ZERO_WIDTH}To: {{pose: home}}}}",
         f"P127 1:11 {no_blank('zero width space U+200B')} ({LEAVE_OUT})"),
        (f" Main:\n{NBSP}{NBSP}GoTo: {{pose: home}}",
         f"P127 2:1 {no_blank('no-break space U+00A0')} ({BLANK})"),
        # Colons and dashes.
        (" Main: {GoTo: {pose：home}}", "P127 1:20 '：' is no ':' (write ':')"),
        (" Main: {GoTo: {pose:home}}",
         "P128 1:21 a blank is missing behind the ':' of 'pose' (write 'pose: home')"),
        (" Main:{GoTo: {pose: home}}",
         "P128 1:7 a blank is missing behind the ':' of 'Main' (write 'Main: …')"),
        (" Main:\n  GoTo:\n   pose: home\n   speed:0.5",
         "P128 4:10 a blank is missing behind the ':' of 'speed' (write 'speed: 0.5')"),
        (" Main:\n  GoTo:\n   pose:home",
         "P230 3:4 the ports of GoTo are a mapping (a blank is missing behind the ':': write 'pose: home')"),
        (" Main:\n  Sequence:\n   SafeRetreat\n   Observe", "P208 3:4 'SafeRetreat Observe' is not an ID "
         "(each node of a list begins with a '-': write '- SafeRetreat')"),
        (" Main:\n  Sequence:\n   – SafeRetreat",
         "P208 3:4 '– SafeRetreat' is not an ID (the '–' is no '-': write '- SafeRetreat')"),
        (" Main:\n  Sequence:\n   - SafeRetreat\n   GoTo: {pose: home}",
         "P128 4:4 a '-' is missing before this entry of the list above (write '- GoTo:')"),
        # Numbers and references.
        (" Main: {Log: {message: '{a} of {b}'}}",
         "P221 1:24 port 'message': {a} is a part of the text '{a} of {b}', and is not replaced there "
         '(a reference is the whole value: write "{= a + \' of \' + b}")'),
        (" Main: {Log: {message: 'n: {= 1 + 1}'}}",
         "P221 1:24 port 'message': {= 1 + 1} is a part of the text 'n: {= 1 + 1}', and is not replaced "
         'there (a reference is the whole value: write "{= \'n: \' + (1 + 1)}")'),
        (" Main: {GoTo: {pose: home, speed: 'fast {a}'}}",
         "P221 1:35 port 'speed': {a} is a part of the text 'fast {a}', and is not replaced there "
         '(a reference is the whole value: write "{a}")'),
        (" Main: {Sleep: {msec: 1_000}}",
         "P220 1:23 port 'msec': '1_000': unknown unit '_000' (s, ms, us, min, h) (write 1000)"),
        (" Main: {Sleep: {msec: '٣'}}", "P220 1:23 port 'msec': '٣' is not a time (as 500 ms) (write 3)"),
        (" Main: {ForEach: {in: ['{a}', x], out: '{c}', do: SafeRetreat}}",
         "P221 1:23 port 'in': a list cannot hold a reference such as {a} (as \"{key}\", a key "
         "that holds the whole list)"),
        (" Main: {Grasp: {object: '{ item }'}}",
         "P221 1:25 port 'object': '{ item }' is not a reference (write \"{item}\")"),
    ],
)  # fmt: skip
def test_a_slip_is_one_fault_at_its_place(body: str, fault: str) -> None:
    assert faults(body)[0] == fault
    assert len(faults(body)) == 1 or "X: 1" in body


def test_what_is_meant_is_read() -> None:
    """A value that is mended has no further faults, unless it is wrong by itself."""
    found = faults(" Main:\n  Sequence:\n   - GoTo: {pose:homme}\n   - “Log”: {message: x}\n")
    assert [fault.split()[0] for fault in found] == ["P128", "P240", "P127"]


def test_all_slips_that_keep_a_file_from_being_read_come_at_once() -> None:
    found = faults(
        " Main:\n  Sequence:\n   - Observe: {camera:'a'}\n   - Log: {message: “a: b”}\n   - X: “a: b”\n"
    )
    assert [fault[:9] for fault in found] == ["P128 3:23", "P127 4:21", "P127 5:9 "]


def test_look_alikes_inside_a_text_and_in_quotes_stay() -> None:
    text = f"a: he said “no” to 20{NBSP}N\nb: “a” and “b”\nc: '{NBSP}“x”{NBSP}'\nd: 12:30:45\ne: [a:b, http://x]\n"
    reading = read(text, "a.yaml")
    assert reading.faults == ()
    assert reading.root.value == {
        "a": f"he said “no” to 20{NBSP}N", "b": "“a” and “b”", "c": f"{NBSP}“x”{NBSP}", "d": "12:30:45",
        "e": ["a:b", "http://x"],
    }  # fmt: skip


def test_the_editor_shows_a_slip_and_mends_the_quantity() -> None:
    text = HEAD + " Main:\n  Sequence:\n   - Observe:{camera: overhead}\n"
    (found,) = document_faults(Path("m.yaml"), text, CHECKS)
    assert (found.fault.code, found.span.start.line, found.span.start.character) == ("P128", 6, 13)
    text = HEAD + " Main: {Sleep: {msec: 5 seconds}}\n"
    (found,) = document_faults(Path("m.yaml"), text, CHECKS)
    assert found.fix is not None
    assert (found.fix.span.start.character, found.fix.span.end.character, found.fix.text) == (22, 31, "5 s")


@given(st.text(alphabet=f"ab: -{{}}[],'\"“”‘{NBSP}{ZERO_WIDTH}：#\n", max_size=60))
def test_any_text_is_read_or_has_a_fault_in_its_lines(text: str) -> None:
    try:
        found = read(text, "a.yaml").faults
    except FileError as error:
        found = error.faults
        assert found
    for fault in found:
        assert 1 <= fault.mark.line <= text.count("\n") + 2  # the end of the file is a line of its own
        assert fault.mark.column >= 1


@pytest.mark.parametrize(
    ("text", "unit", "meant"),
    [
        ("500 msec", "s", "500 ms"),
        ("5 seconds", "s", "5 s"),
        ("0,5 s", "s", "0.5 s"),
        ("1 000 ms", "s", "1000 ms"),
        ("1.000,5 ms", "s", "1000.5 ms"),
        ("1'000 ms", "s", "1000 ms"),
        ("500 MS", "s", "500 ms"),
        ("1/2 s", "s", "0.5 s"),
        ("½ s", "s", "0.5 s"),
        ("5 s.", "s", "5 s"),
        ("~5 s", "s", "5 s"),
        ("−5 s", "s", "-5 s"),
        ("1 min 30 s", "s", "90 s"),
        ("2 kgf", "N", "19.6133 N"),
        ("20 N·m", "Nm", "20 Nm"),
        ("２０ newtons", "N", "20 N"),
        ("90 degrees per second", "rad/s", "90 deg/s"),
        ("5 m/sec", "m/s", "5 m/s"),
        ("3 m/s^2", "m/s2", "3 m/s2"),
        ("50 percent", "", "50 %"),
        (f"20{NBSP}N", "N", "20 N"),
        ("“20 N”", "N", "20 N"),
        ("3 Kg", "kg", "3 kg"),
        ("5 m", "s", ""),
        ("nan", "s", ""),
        ("five seconds", "s", ""),
        ("5 MN", "N", ""),
        ("1,500 m", "m", ""),
        ("3..5 mm", "m", ""),
        ("0x10", "N", ""),
    ],
)
def test_a_quantity_in_another_spelling(text: str, unit: str, meant: str) -> None:
    assert suggest_quantity(text, unit) == meant


@given(st.text(max_size=30), st.sampled_from(["m", "rad", "", "N", "s"]))
def test_a_hint_is_a_quantity_that_is_read(text: str, unit: str) -> None:
    from picktree.files.quantities import parse_quantity

    hint = suggested(text, unit)
    if hint.startswith("write "):
        parse_quantity(hint.removeprefix("write "), unit)
    assert units_like(unit)
