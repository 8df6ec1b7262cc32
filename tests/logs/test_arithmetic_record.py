"""The record of the arithmetic: what it holds, and how two of them are compared."""

from __future__ import annotations

from dataclasses import replace

from picktree.logs.arithmetic_record import Arithmetic, arithmetic_difference
from picktree.session import arithmetic

THEN = Arithmetic(
    versions={"numpy": "2.4.6", "glibc": "2.36"},
    kernels={"numpy": "X86_V3", "OpenBLAS in numpy": "Haswell, 1 thread"},
    probe={"numpy": "01", "OpenBLAS": "02"},
)


def test_the_record_of_this_process_names_all_that_computes() -> None:
    here = arithmetic()
    assert set(here.versions) == {
        "numpy", "scipy", "pybullet", "pinocchio", "coal", "OpenCV", "OpenBLAS", "glibc", "Python"
    }  # fmt: skip
    assert "unknown" not in here.versions.values()
    assert here.kernels["numpy"] == "X86_V3"
    assert here.kernels["OpenBLAS in numpy"] == "Haswell, 1 thread"
    assert here.kernels["OpenBLAS in scipy"] == "Haswell, 1 thread"
    assert Arithmetic.from_words(here.words()) == here


def test_the_same_arithmetic_has_no_departure() -> None:
    assert arithmetic_difference(THEN, THEN) == ""


def test_another_version_is_named_on_both_sides() -> None:
    now = replace(THEN, versions={**THEN.versions, "glibc": "2.41"})
    said = "recorded with other arithmetic (glibc 2.36, here 2.41): the runs may part"
    assert arithmetic_difference(THEN, now) == said
    assert arithmetic_difference(THEN, now, "in B") == said.replace("here", "in B")


def test_other_kernels_are_named_when_the_probe_shows_them() -> None:
    kernels = {**THEN.kernels, "OpenBLAS in numpy": "Sandybridge, 1 thread"}
    now = replace(THEN, kernels=kernels, probe={**THEN.probe, "OpenBLAS": "03"})
    assert arithmetic_difference(THEN, now) == (
        "recorded with other arithmetic (OpenBLAS in numpy Haswell, 1 thread, here Sandybridge, 1 thread): "
        "the runs may part"
    )
    assert arithmetic_difference(THEN, replace(THEN, kernels=kernels)) == "", "names alone change no number"


def test_a_known_reason_for_other_kernels_comes_first() -> None:
    kernels = {**THEN.kernels, "numpy": "AVX512_ICL"}
    late = replace(
        THEN,
        kernels=kernels,
        probe={**THEN.probe, "numpy": "11"},
        departures={"numpy": "imported before picktree"},
    )
    assert arithmetic_difference(late, THEN) == (
        "recorded with other arithmetic (numpy imported before picktree; numpy AVX512_ICL, here X86_V3): the "
        "runs may part"
    )
    assert arithmetic_difference(THEN, late) == (
        "recorded with other arithmetic (numpy imported before picktree here; numpy X86_V3, here "
        "AVX512_ICL): the runs may part"
    )
    assert arithmetic_difference(late, late) == ""
    assert Arithmetic.from_words(late.words()) == late


def test_a_probe_that_differs_for_no_known_reason_is_said() -> None:
    now = replace(THEN, probe={"numpy": "11", "OpenBLAS": "12"})
    assert arithmetic_difference(THEN, now) == (
        "recorded with other arithmetic (other results of numpy and OpenBLAS here): the runs may part"
    )


def test_an_older_log_has_no_record() -> None:
    assert (
        arithmetic_difference(Arithmetic(), THEN) == "arithmetic not recorded: the log is of an older version"
    )
