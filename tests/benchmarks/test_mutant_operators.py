"""Which mistakes are made where, and which of them are drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
Program = Callable[[str], ModuleType]


def changes(program: Program, source: str) -> list[tuple[str, str]]:
    """Operator and changed line of each mutant within a function."""
    found = program("_mutant_operators").mutants("m.py", f"def f(a, b, c):\n    {source}\n")
    return [(mutant.operator, mutant.after) for mutant in found]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a = b < c", [("boundary", "a = b <= c"), ("comparison", "a = b >= c")]),
        ("a = b == c", [("comparison", "a = b != c")]),
        ("a = b not in c", [("comparison", "a = b in c")]),
        ("a = (b) is (c)", [("comparison", "a = (b) is not (c)")]),
        ("a = a and b and c", [("and/or", "a = a or b and c"), ("and/or", "a = a and b or c")]),
        ("a = not b", [("not", "a = b")]),
        ("a = b if c else a", [("not", "a = b if not c else a")]),
        ("a = [b for b in c if b]", [("not", "a = [b for b in c if not b]")]),
        ("a = b + c", [("arithmetic", "a = b - c")]),
        ("a = -b", [("arithmetic", "a = b")]),
        ("a = b.inverse() @ c", [("arithmetic", "a = (c) @ (b.inverse())")]),
        ("a = v @ v", []),
        ("a += b", [("deletion", "pass"), ("arithmetic", "a -= b")]),
        ("a = True", [("constant", "a = False")]),
        ("a = 3", [("constant", "a = 6"), ("constant", "a = 1"), ("constant", "a = 4")]),
        ("a = 0.0", [("constant", "a = 1.0")]),
        ("a = 1e-9", [("constant", "a = 1.000000001")]),
        ("return a.b", [("return", "return None")]),
        ("return [b, c]", [("return", "return []")]),
        ("return a or b", [("return", "return not (a or b)"), ("and/or", "return a and b")]),
        ("a.b = c", [("deletion", "pass")]),
        ("raise a", [("deletion", "pass")]),
        ("yield from a", [("deletion", "pass")]),
        ("while a: break", [("not", "while not a: break"), ("break", "while a: continue")]),
    ],
)
def test_the_mistakes_of_a_place(program: Program, source: str, expected: list[tuple[str, str]]) -> None:
    assert changes(program, source) == expected


@pytest.mark.parametrize(
    "source",
    [
        '"""Of 3 and more."""',
        'a = f"{1000 * b:.1f} mm"',
        "a: list[int | None] = b",
        "assert a > 0, b",
        "a = isinstance(b, int | str)",
        "a = cast(int | str, b)",
        "a = dict[str, int | None](b)",
        "a = zip(b, c, strict=True)",
        "self.feedback_message = a",
        "a = b",
        "import a",
    ],
)
def test_what_is_no_behaviour_is_left_alone(program: Program, source: str) -> None:
    assert changes(program, source) == []


def test_declarations_are_left_alone(program: Program) -> None:
    source = """
        from typing import TYPE_CHECKING, TypeAlias
        if TYPE_CHECKING:
            SIZE = 3
        __all__ = ["f"] + ["g"]
        Number: TypeAlias = int | float
        @dataclass(frozen=True)
        class Box:
            size: Annotated[float, 3]
            @cache(7)
            def f(self, a: Literal[3]) -> Literal[4]: ...
    """
    assert program("_mutant_operators").mutants("m.py", dedent(source)) == []


MODULE = dedent('''
    """A module."""
    NEAR = 0.04  # größer als nötig
    FAR = 0.5


    class Gate:
        width: float = 2.0

        def __init__(self) -> None:
            self.open = NEAR

        def passes(self, size: float, slack: float = 3.0) -> bool:
            return (
                size < self.width  # and not <=
                and size > slack
            )


    def first() -> int:
        for n in range(3):
            if n:
                return n
        return 7
''').lstrip()


def of_module(program: Program, operator: str, before: str, source: str = MODULE) -> list:
    found = program("_mutant_operators").mutants("m.py", source)
    return [mutant for mutant in found if (mutant.operator, mutant.before) == (operator, before)]


def test_lines_that_tell_whether_a_place_runs(program: Program) -> None:
    boundary = of_module(program, "boundary", "size < self.width  # and not <=")[0]
    assert (boundary.function, boundary.line) == ("Gate.passes", 14)
    assert (boundary.near, boundary.far, boundary.declares) == ({14}, {13, 15, 16}, False)
    condition = of_module(program, "not", "if n:")[0]
    assert (condition.near, condition.far) == ({21}, set())  # what stands in the block is no part of it


def test_lines_that_use_what_runs_at_import_alone(program: Program) -> None:
    constant = of_module(program, "constant", "NEAR = 0.04  # größer als nötig")[0]
    assert (constant.function, constant.near, constant.declares) == ("", {10}, True)
    assert constant.far == {13, 14, 15, 16, 20, 21, 22, 23}
    pair = of_module(program, "constant", "A, B = 1, 2", "A, B = 1, 2\ndef f():\n    a = A\n    return B\n")
    assert [sorted(mutant.near) for mutant in pair] == [[3]] * 2 + [[4]] * 3
    attribute = of_module(program, "constant", "width: float = 2.0")[0]
    assert (attribute.function, attribute.near) == ("Gate", {14})
    default = of_module(program, "constant", "def passes(self, size: float, slack: float = 3.0) -> bool:")[0]
    assert (default.near, default.far) == ({15}, {13, 14, 16})


def test_a_mutant_changes_its_place_and_nothing_else(program: Program) -> None:
    mutant = of_module(program, "boundary", "size < self.width  # and not <=")[0]
    assert mutant.source(MODULE) == MODULE.replace("size < self", "size <= self")
    assert (mutant.module, mutant.after) == ("picktree.m", "size <= self.width  # and not <=")


def test_a_key_outlives_that_lines_move(program: Program) -> None:
    before = program("_mutant_operators").mutants("m.py", MODULE)
    after = program("_mutant_operators").mutants(
        "m.py", MODULE.replace("FAR = 0.5\n", "FAR = 0.5\n\n\nHERE = ''\n")
    )
    assert [mutant.identity for mutant in after] == [mutant.identity for mutant in before]
    assert after[-1].line == before[-1].line + 3


def test_places_that_look_alike_are_told_apart(program: Program) -> None:
    twice = "def f(a):\n    a += 1\n    a += 1\n"
    alike = of_module(program, "deletion", "a += 1", twice)
    assert [mutant.nth for mutant in alike] == [0, 1]
    assert alike[0].key == alike[1].key
    assert alike[0].identity != alike[1].identity


def test_only_the_functions_that_are_wanted(program: Program) -> None:
    operators = program("_mutant_operators")
    assert {mutant.function for mutant in operators.mutants("m.py", MODULE, ["first"])} == {"first"}
    with pytest.raises(ValueError, match=r"^m\.py has nothing to mutate in second$"):
        operators.mutants("m.py", MODULE, ["first", "second"])


def test_a_sample_holds_one_mutant_of_each_of_its_places(program: Program) -> None:
    operators = program("_mutant_operators")
    found = operators.mutants("m.py", MODULE)
    places = {mutant.place for mutant in found}
    drawn = operators.sample(found, 1000, seed=1)
    assert len(drawn) == len(places) < len(found)
    assert {mutant.place for mutant in drawn} == places
    assert operators.sample(found, 5, seed=1) == drawn[:5]
    assert operators.sample(found, 5, seed=2) != drawn[:5]


def test_a_sample_stays_when_something_else_changes(program: Program) -> None:
    operators = program("_mutant_operators")
    longer = MODULE + "\n\ndef last(a):\n    return a + 1\n"
    before = [mutant.identity for mutant in operators.sample(operators.mutants("m.py", MODULE), 99, seed=1)]
    after = [mutant.identity for mutant in operators.sample(operators.mutants("m.py", longer), 99, seed=1)]
    assert [each for each in after if each in before] == before


def test_variants_of_a_place_are_equally_likely(program: Program) -> None:
    operators = program("_mutant_operators")
    source = "".join(f"def f{n}(a):\n    return a < {n}\n" for n in range(300))
    drawn = operators.sample(operators.mutants("m.py", source), 1000, seed=0)
    boundaries = sum(mutant.operator == "boundary" for mutant in drawn)
    comparisons = sum(mutant.operator == "comparison" for mutant in drawn)
    assert boundaries + comparisons == 300
    assert abs(boundaries - 150) < 45  # five sigmas


@pytest.mark.parametrize("file", ["recovery/recover.py", "robot/control/safety_monitor.py"])
def test_mutants_of_real_modules_compile(program: Program, file: str) -> None:
    source = (ROOT / file).read_text(encoding="utf-8")
    found = program("_mutant_operators").mutants(file, source)
    assert len(found) > 40
    for mutant in found:
        compile(mutant.source(source), file, "exec")
        assert mutant.before != mutant.after
