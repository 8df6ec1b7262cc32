"""The missions and sub-trees that come with picktree, rehearsed, and the page on rehearsals."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from picktree.authoring.rehearsal import Rehearsal, rehearse, rehearse_files
from picktree.authoring.rehearsal.cases import Expectation, LeafAnswer
from picktree.authoring.rehearsal.rehearsal import to_text
from picktree.files.yaml import file_models
from picktree.trees.loading import load_mission

from ..trees.rehearsing import case_file

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGE = (ROOT / "docs" / "rehearsal.md").read_text(encoding="utf-8")
MISSIONS = [f for f in sorted(EXAMPLES.glob("*.yaml")) if "\nkind: mission\n" in f.read_text("utf-8")]


@pytest.mark.parametrize("mission", MISSIONS, ids=lambda file: file.stem)
def test_the_cases_of_an_example_pass_and_reach_all_of_it(mission: Path) -> None:
    rehearsal = rehearse_files(mission)
    assert {case.name: case.differences for case in rehearsal.failed} == {}
    assert [str(mark) for case in rehearsal.cases for mark in case.unused] == []
    assert [f"{point.mark} {point.missed}" for point in rehearsal.coverage.missed] == []


def rehearsed(tmp_path: Path, trees: str, cases: str) -> Rehearsal:
    """A mission that includes the library's trees, in the scene of the examples."""
    file = tmp_path / "mission.yaml"
    file.write_text(
        "picktree: 1\nkind: mission\nscene: three_bins\ninclude: [library/sorting, library/recovery]\n"
        f"trees:\n  Main:\n{trees}",
        encoding="utf-8",
    )
    mission = load_mission(file)
    return rehearse(mission, case_file(cases, mission))


def missed(rehearsal: Rehearsal) -> list[str]:
    return [f"{point.node}: {point.missed}" for point in rehearsal.coverage.missed]


def test_pick_and_place_of_the_library(tmp_path: Path) -> None:
    rehearsal = rehearsed(
        tmp_path,
        '    Sequence: [{Observe: {objects: "{items}"}}, {PickAndPlaceAll: {items: "{items}"}}]\n',
        """
        objects: {red: {kind: block, colour: red}, blue: {kind: can, colour: blue}}
        cases:
          well: {expect: {status: SUCCESS, order: [Observe, Grasp, Place, Grasp, Place]}}
          disturbed: {leaves: {Grasp: [world.disturbed, SUCCESS]}, expect: {status: SUCCESS}}
          missed:
            leaves: {Grasp: [grasp.missed, SUCCESS]}
            expect: {status: SUCCESS, order: [Observe, Grasp, SafeRetreat, Observe, "..."]}
          hemmed_in: {leaves: {Grasp: [grasp.no_candidate, SUCCESS]}, expect: {status: SUCCESS}}
          slipped: {leaves: {Place: [grasp.slipped, SUCCESS]}, expect: {status: SUCCESS}}
          gone: {leaves: {Grasp: [world.unknown_object, SUCCESS]}, expect: {status: SUCCESS}}
          held_up: {leaves: {Place: [control.timeout, SUCCESS]}, expect: {status: SUCCESS}}
          stopped: {leaves: {Place: [safety.stop, SUCCESS]}, expect: {status: SUCCESS}}
          in_vain:
            leaves: {Place: place.full}
            expect:
              status: SUCCESS
              handled: [{cause: place.full, by: PickAndPlaceAll/ForEach, times: 2}]
              facts: {items_to_do: 2, holding: false}
        """,
    )
    assert {case.name: case.differences for case in rehearsal.failed} == {}
    assert missed(rehearsal) == []


def test_cures_of_the_library(tmp_path: Path) -> None:
    rehearsal = rehearsed(
        tmp_path,
        "    Sequence: [LookAgain, RetreatAndLook, {WaitAndLook: {pause: 200 ms}}, LetGoAndRetreat]\n",
        """
        cases:
          it:
            leaves: {SafeRetreat: {ticks: 2}}
            expect: {status: SUCCESS, ticks: 9, order: [Observe, SafeRetreat, Observe, Observe, SafeRetreat]}
        """,
    )
    assert {case.name: case.differences for case in rehearsal.failed} == {}
    assert rehearsal.cases[0].ticks == 9
    assert missed(rehearsal) == []


def block(language: str) -> str:
    found = re.search(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def test_the_case_of_the_page_passes_and_prints_what_it_shows(tmp_path: Path) -> None:
    shutil.copy(EXAMPLES / "sort_by_colour.yaml", tmp_path)
    (tmp_path / "cases.yaml").write_text(block("yaml"), encoding="utf-8")
    rehearsal = rehearse_files(tmp_path / "sort_by_colour.yaml", tmp_path / "cases.yaml")
    assert rehearsal.passed
    assert to_text(rehearsal).startswith(block("text") + "\ncoverage ")


def test_the_python_of_the_page_runs() -> None:
    names: dict[str, object] = {"Path": lambda name: EXAMPLES / name}
    exec(block("python"), names)
    assert "rehearsal" in names


def test_the_page_names_all_that_may_be_expected_and_answered() -> None:
    expected = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| ", PAGE, re.MULTILINE)
    assert set(re.findall(r"\w+", " ".join(expected))) == set(file_models.keys_of(Expectation))
    assert [name for name in file_models.keys_of(LeafAnswer) if f"`{name}`" not in PAGE] == []
