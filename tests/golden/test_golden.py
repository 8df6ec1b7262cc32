"""Golden runs: the simulation is the one whose digests were recorded."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.golden import runs

from .runs import GOLDEN, GoldenError, Record, changes, compute, differing, libraries

CHANGED = """\
the simulation has changed: the same seed gives another run than tests/golden/digests.json records. {}. \
Where that is meant, `make golden` records the digests again; say in CHANGELOG.md why they are others"""


@pytest.fixture(scope="module")
def recorded() -> Record:
    """The recorded digests; the test is skipped where they were computed with other libraries."""
    record = Record.read()
    if others := differing(record.libraries, libraries()):
        pytest.skip(f"the digests were recorded with other libraries; here is {others}")
    return record


@pytest.mark.parametrize("name", GOLDEN)
def test_a_golden_run_has_its_recorded_digest(name: str, recorded: Record) -> None:
    known = {name: recorded.digests.get(name, "none")}
    changed = changes(known, {name: compute(name).digest})
    assert not changed, CHANGED.format(*changed)


def test_no_digest_is_recorded_of_a_run_that_is_gone() -> None:
    assert set(Record.read().digests) == set(GOLDEN)


def test_a_golden_run_without_what_it_is_there_for_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "GOLDEN", {"walls": replace(GOLDEN["walls"], scene=None)})
    with pytest.raises(GoldenError, match=r"^walls ended with success, and its log has no plan: RRTConnect$"):
        compute("walls")


def test_libraries_are_named_only_where_they_differ() -> None:
    known = {"numpy": "2.4.6", "glibc": "2.36", "coal": "3.0.3"}
    assert differing(known, known) == ""
    assert differing(known, {"numpy": "2.5.0", "glibc": "2.36", "zlib": "1.3"}) == (
        "numpy 2.5.0 instead of 2.4.6, coal none instead of 3.0.3, zlib 1.3 instead of none"
    )


def test_every_run_that_changed_came_or_went_is_named() -> None:
    known = {"pick": "ab", "push": "cd", "gone": "ef"}
    assert changes(known, known) == []
    assert changes(known, {"pick": "ab", "push": "00", "new": "11"}) == [
        "push: cd is recorded, 00 is computed",
        "gone: ef is recorded, none is computed",
        "new: none is recorded, 11 is computed",
    ]
