"""Comments that silence warnings: where they are seen, what they silence, and what is said against them."""

from __future__ import annotations

import pytest

from picktree.files import Diagnostic, Mark, Severity
from picktree.files.fault_codes import apply_suppressions

KNOWN = ("P207", "P304", "P305")


def fault(code: str, line: int, severity: Severity = "warning") -> Diagnostic:
    return Diagnostic(Mark("m.yaml", line, 5), "", "a sentence", "", code, severity)


def left(text: str, *faults: Diagnostic, complete: bool = True) -> list[str]:
    kept = apply_suppressions(faults, text, "m.yaml", KNOWN, complete=complete)
    return [f"{f.mark.line}:{f.mark.column} {f.severity} {f.code} {f.message} ({f.hint})" for f in kept]


def test_a_warning_on_the_line_of_the_comment_is_silenced() -> None:
    text = "a: b  # picktree: allow P304\nc: d\n"
    assert left(text, fault("P304", 1)) == []
    assert left(text, fault("P304", 1), fault("P304", 2)) == ["2:5 warning P304 a sentence ()"]


@pytest.mark.parametrize(
    "comment",
    [
        "# picktree: allow P304",
        "#picktree:allow P304",
        "# picktree: allow P304 because the loop ends by itself",
        "# see above # picktree: allow P304",
    ],
)
def test_how_the_comment_may_be_written(comment: str) -> None:
    assert left(f"a: b {comment}\n", fault("P304", 1)) == []


def test_several_codes() -> None:
    text = "a: b  # picktree: allow P304, P305 (both are meant)\n"
    assert left(text, fault("P304", 1), fault("P305", 1)) == []
    assert left(text, fault("P304", 1)) == [
        "1:7 warning P130 there is no warning P305 on this line (leave the comment out)"
    ]


def test_an_error_cannot_be_silenced() -> None:
    assert left("a: b  # picktree: allow P207\n", fault("P207", 1, "error")) == [
        "1:5 error P207 a sentence ()",
        "1:7 warning P131 P207 is an error: no comment allows it (mend it)",
    ]


def test_what_errors_kept_from_being_found_is_not_missed() -> None:
    text = "a: b  # picktree: allow P304\n"
    assert left(text, fault("P207", 3, "error"), complete=False) == ["3:5 error P207 a sentence ()"]


def test_of_a_text_that_cannot_be_read_no_comment_is_known() -> None:
    text = "a: 'b # picktree: allow P304\nc: d # picktree: nonsense\n"
    assert left(text, fault("P101", 1, "error"), complete=False) == ["1:5 error P101 a sentence ()"]


@pytest.mark.parametrize(
    ("comment", "said"),
    [
        ("allow P344", "there is no code 'P344' (did you mean 'P304'?)"),
        ("allow loops", "there is no code 'loops' (as '# picktree: allow P304')"),
        ("allow", "this comment to picktree is not understood (as '# picktree: allow P304')"),
        ("ignore P304", "this comment to picktree is not understood (as '# picktree: allow P304')"),
        ("", "this comment to picktree is not understood (as '# picktree: allow P304')"),
    ],
)
def test_comments_that_are_not_understood(comment: str, said: str) -> None:
    assert left(f"a: b # picktree: {comment}\n") == [f"1:6 warning P131 {said}"]


@pytest.mark.parametrize(
    "text",
    [
        'a: "b # picktree: allow P304"\n',
        "a: 'b # picktree: allow P304'\n",
        "a: 'b\n  # picktree: allow P304\n\n  c'\n",
        "a: |\n  # picktree: allow P304\n",
        "a: >-\n  b\n  # picktree: allow P304\nc: d\n",
        "a: b#picktree: allow P304\n",
    ],
)
def test_a_text_that_looks_like_a_comment_is_none(text: str) -> None:
    lines = text.count("\n")
    warnings = [fault("P304", line + 1) for line in range(lines)]
    assert len(left(text, *warnings)) == lines


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: | # picktree: allow P304\n  b\n", 1),
        ("a: |\n  b\n# picktree: allow P304\n", 3),
        ("a: |\n  b\n # picktree: allow P304\nc: d\n", 3),
        ("a: 'é日本' # picktree: allow P304\n", 1),
        ("# picktree: allow P304\na: b\n", 1),
        ("a: [b, # picktree: allow P304\n  c]\n", 1),
        ("a: b\r\nc: d # picktree: allow P304\r\n", 2),
        ('"a": "b" # picktree: allow P304', 1),
    ],
)
def test_comments_between_and_behind_values(text: str, line: int) -> None:
    assert left(text, fault("P304", line)) == []
