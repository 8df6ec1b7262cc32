"""The record of the arithmetic: what it holds, and how two of them are compared."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.logs.arithmetic_record import Arithmetic, arithmetic_difference
from picktree.session import arithmetic

THEN = Arithmetic(
    versions={"numpy": "2.4.6", "glibc": "2.36"},
    kernels={"numpy": "X86_V3", "OpenBLAS in numpy": "Haswell, 1 thread"},
    probe={"numpy": "01", "OpenBLAS": "02"},
)
NEWER = replace(THEN, versions={**THEN.versions, "glibc": "2.41"})
OTHER_NAMES = replace(THEN, kernels={**THEN.kernels, "OpenBLAS in numpy": "Sandybridge, 1 thread"})
OTHER_KERNELS = replace(OTHER_NAMES, probe={**THEN.probe, "OpenBLAS": "03"})
LATE = replace(
    THEN,
    kernels={**THEN.kernels, "numpy": "AVX512_ICL"},
    probe={**THEN.probe, "numpy": "11"},
    departures={"numpy": "imported before picktree"},
)
UNEXPLAINED = replace(THEN, probe={"numpy": "11", "OpenBLAS": "12"})


def test_the_record_of_this_process_names_all_that_computes() -> None:
    here = arithmetic()
    assert set(here.versions) == {
        "numpy", "scipy", "pybullet", "pinocchio", "coal", "OpenCV", "OpenBLAS", "glibc", "Python"
    }  # fmt: skip
    assert "unknown" not in here.versions.values()
    assert here.kernels["numpy"] == "X86_V3"
    assert here.kernels["OpenBLAS in numpy"] == "Haswell, 1 thread"
    assert here.kernels["OpenBLAS in scipy"] == "Haswell, 1 thread"
    for record in (here, LATE):
        assert Arithmetic.from_words(record.words()) == record


@pytest.mark.parametrize(
    ("then", "now", "why"),
    [
        (THEN, NEWER, "glibc 2.36, here 2.41"),
        (THEN, OTHER_KERNELS, "OpenBLAS in numpy Haswell, 1 thread, here Sandybridge, 1 thread"),
        # A known reason comes before the names of the kernels.
        (LATE, THEN, "numpy imported before picktree; numpy AVX512_ICL, here X86_V3"),
        (THEN, LATE, "numpy imported before picktree here; numpy X86_V3, here AVX512_ICL"),
        (THEN, UNEXPLAINED, "other results of numpy and OpenBLAS here"),
    ],
)
def test_another_arithmetic_is_named_on_both_sides(then: Arithmetic, now: Arithmetic, why: str) -> None:
    said = f"recorded with other arithmetic ({why}): the runs may diverge"
    assert arithmetic_difference(then, now) == said
    assert arithmetic_difference(then, now, "in B") == said.replace("here", "in B")


@pytest.mark.parametrize(
    ("then", "now", "said"),
    [
        (THEN, THEN, ""),
        (LATE, LATE, ""),
        (THEN, OTHER_NAMES, ""),  # names alone change no number
        (Arithmetic(), THEN, "arithmetic not recorded: the log is of an older version"),
    ],
)
def test_the_same_numbers_have_no_difference_and_old_logs_no_record(
    then: Arithmetic, now: Arithmetic, said: str
) -> None:
    assert arithmetic_difference(then, now) == said
