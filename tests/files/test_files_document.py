"""Documents: the texts of faults, YAML 1.2 scalars, places, bounds."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.files import FileError, Mark, suggest_name, where
from picktree.files.yaml import Value, merge_patch, read_document

HEAD = "picktree: 1\nkind: mission\n"
HERE = Path("m.yaml")


def refused(text: str, kind: str | None = None) -> str:
    """Return the faults of a text's form, whether it can be read in spite of them or not."""
    try:
        faults = read_document(HERE, kind, text).faults
    except FileError as error:
        faults = error.faults
    assert faults
    return str(FileError(faults))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"),
        ("on", "on"),
        ("yes", "yes"),
        ("true", True),
        ("FALSE", False),
        ("tRUE", "tRUE"),
        ("~", None),
        ("", None),
        ("Null", None),
        ("1e-3", 0.001),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("-7", -7),
        ("+.5", 0.5),
        ("1.", 1.0),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2026-01-02", "2026-01-02"),
        ("0b11", "0b11"),
        ("'12'", "12"),
        ('"true"', "true"),
        ("=", "="),
    ],
)
def test_scalars_are_read_by_yaml_1_2(text: str, value: Value) -> None:
    assert read_document(HERE, text=f"{HEAD}a: {text}\n").data["a"] == value
    assert type(read_document(HERE, text=f"{HEAD}a: {text}\n").data["a"]) is type(value)


def test_nan_is_a_number() -> None:
    value = read_document(HERE, text=f"{HEAD}a: .NaN\n").data["a"]
    assert isinstance(value, float)
    assert math.isnan(value)


def test_keys_are_texts_as_written() -> None:
    assert list(read_document(HERE, text=f"{HEAD}1: a\nno: b\n0x10: c\n").data)[2:] == ["1", "no", "0x10"]


def test_places() -> None:
    document = read_document(HERE, text=f"{HEAD}a:\n  b: [10, é, {{c: 3}}]\n")
    assert document.mark(("a", "b", 2, "c")) == Mark("m.yaml", 4, 18)
    assert document.key_mark(("a", "b", 2, "c")) == Mark("m.yaml", 4, 15)
    assert document.mark(("a", "b", 2, "absent", "deeper")) == Mark("m.yaml", 4, 14)
    assert document.get(("a", "b", 1)) == "é"
    assert document.get(("a", "x")) is None
    assert (
        str(document.fault(("a", "b", 0), "is ten", "try nine", code="P107"))
        == "m.yaml:4:7: a.b[0]: is ten (try nine)"
    )


def test_aliases_repeat_a_value() -> None:
    document = read_document(HERE, text=f"{HEAD}a: &x {{b: 1}}\nc: *x\n")
    assert document.data["c"] == {"b": 1}
    assert document.mark(("c", "b")) == Mark("m.yaml", 3, 11)


FAULTY = [
    ("# only a comment\n", "m.yaml:1:1: the file is empty (it begins with 'picktree: 1')"),
    ("- a", "m.yaml:1:1: a file is a mapping that begins with 'picktree: 1'"),
    (
        "a: 1",
        "m.yaml:1:1: 'picktree: 1' is missing (every file begins with it)\n"
        "m.yaml:1:1: 'kind:' is missing (one of mission, scene, robot, faults, cases, plan)",
    ),
    (
        "picktree: true\nkind: [a]",
        "m.yaml:1:11: picktree: the format is a whole number (this is format 1)\n"
        "m.yaml:2:7: kind: the kind is a word, not a list "
        "(one of mission, scene, robot, faults, cases, plan)",
    ),
    (
        HEAD + "object: {item}\nb: { item.colour }\nc: {item: }\nd: [{x}]",
        'm.yaml:3:9: object: {item} without quotes is a YAML mapping (write "{item}")\n'
        'm.yaml:4:4: b: {item.colour} without quotes is a YAML mapping (write "{item.colour}")\n'
        'm.yaml:6:5: d[0]: {x} without quotes is a YAML mapping (write "{x}")',
    ),
    (
        HEAD + "a: &a [*a]",
        "m.yaml:3:8: a[0]: *a has no anchor before it "
        "(put the anchor &… earlier in the file; quote a text that begins with *)",
    ),
    (HEAD + "a: b: c", "m.yaml:3:5: not valid YAML: a ':' does not fit here (quote the text, or indent it)"),
    (HEAD + "? [1]\n: 2", 'm.yaml:3:3: a key is a word, not […] (a reference is quoted: "{item}")'),
    (HEAD + "{a}: 2", 'm.yaml:3:1: a key is a word, not {…} (a reference is quoted: "{item}")'),
    (HEAD + "a: " + "9" * 5000, "m.yaml:3:4: a: the number has too many digits"),
    (HEAD + "'': 1", "m.yaml:3:1: a key is missing before ':'"),
    (
        HEAD + "a: " + "[" * 5000,
        "m.yaml:3:203: a[0][0][0][0][0][0][0][0][0][0][0]…: the file is nested more than 200 deep",
    ),
]


@pytest.mark.parametrize(("text", "message"), FAULTY, ids=[str(n) for n in range(len(FAULTY))])
def test_faulty_documents(text: str, message: str) -> None:
    assert refused(text) == message


def test_another_kind_is_refused() -> None:
    message = "m.yaml:2:7: kind: this is a mission file; a scene file is wanted here"
    assert refused(HEAD, "scene") == message


def test_aliases_do_not_explode() -> None:
    lines = ["a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    for n in range(9):
        one, two = chr(97 + n), chr(98 + n)
        lines.append(f"{two}: &{two} [{', '.join([f'*{one}'] * 10)}]")
    assert refused(HEAD + "\n".join(lines)) == (
        "m.yaml:7:20: e[3]: the file has more than 50000 values, each alias counted with all its values"
    )


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    def message(path: Path) -> str:
        with pytest.raises(FileError) as caught:
            read_document(path)
        return str(caught.value).removeprefix(str(path))

    (tmp_path / "latin.yaml").write_bytes(b"picktree: 1\nkind: mission\nname: caf\xe9\n")
    (tmp_path / "wide.yaml").write_bytes("picktree: 1\n".encode("utf-16"))
    assert message(tmp_path / "none.yaml") == ":1:1: there is no such file"
    assert message(tmp_path) == ":1:1: this is a folder, not a file"
    assert message(tmp_path / "latin.yaml") == ":3:10: the file is not UTF-8 (save it as UTF-8)"
    assert (
        message(tmp_path / "wide.yaml") == ":1:1: the file is UTF-16 or UTF-32, not UTF-8 (save it as UTF-8)"
    )
    assert message(Path("a\x00b")) == ":1:1: this is no path: it holds a null character"


def test_a_byte_order_mark_and_windows_lines_are_read(tmp_path: Path) -> None:
    path = tmp_path / "w.yaml"
    path.write_bytes(b"\xef\xbb\xbfpicktree: 1\r\nkind: scene\r\na: 1\r\n")
    document = read_document(path, "scene")
    assert document.data == {"picktree": 1, "kind": "scene", "a": 1}
    assert document.mark(("a",)).line == 3


def test_one_document_laid_on_another() -> None:
    base = read_document(Path("base.yaml"), text=f"{HEAD}a: {{b: 1, c: 2}}\nd: [1, 2]\ne: 5\n")
    over = read_document(HERE, text=f"{HEAD}a: {{b: 7}}\nd: [3]\ne: null\n")
    merged = merge_patch(base, over)
    assert merged.data == {"picktree": 1, "kind": "mission", "a": {"b": 7, "c": 2}, "d": [3]}
    assert merged.mark(("a", "b")).file == "m.yaml"
    assert merged.mark(("a", "c")) == Mark("base.yaml", 3, 14)
    assert base.data["a"] == {"b": 1, "c": 2}


def test_hints() -> None:
    assert suggest_name("grasp", ["Place", "Grasp"]) == "did you mean 'Grasp'?"
    assert suggest_name("xyzzy", ["a", "b", "a"]) == "known: a, b"
    assert suggest_name("x", []) == ""
    assert where(("trees", "Main", 0, "Grasp")) == "trees.Main[0].Grasp"


YAMLISH = st.text(st.sampled_from(list("ab01:-?[]{},#&*!|>'\"%@` \n\t.~<é\x85\u2028")), max_size=60)


@given(st.one_of(YAMLISH, YAMLISH.map(lambda t: f"{HEAD}a: {t}\n"), st.text(max_size=40)))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        document = read_document(HERE, text=text)
    except FileError as error:
        assert error.faults
        lines = text.count("\n") + text.count("\r") + text.count("\x85") + text.count("\u2028") + 2
        assert all(1 <= f.mark.line <= lines + text.count("\u2029") for f in error.faults)
    else:
        assert document.data["picktree"] == 1


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, raw: bytes) -> None:
    path = tmp_path_factory.mktemp("f") / "f.yaml"
    path.write_bytes(HEAD.encode() + raw)
    try:
        read_document(path)
    except FileError as error:
        assert error.faults
