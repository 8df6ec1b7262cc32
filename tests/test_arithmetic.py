"""One arithmetic in every process, whatever its environment says."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.files import PicktreeError, arithmetic

PROBE = """
import json
from picktree.session import arithmetic
print(json.dumps(arithmetic().words()))
"""


def words(program: str = PROBE, **environment: str) -> dict[str, str]:
    """Words of the arithmetic of a new process."""
    clean = {k: v for k, v in os.environ.items() if k not in arithmetic.PINNED}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**clean, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def pinned() -> dict[str, str]:
    return words()


@pytest.mark.parametrize(
    "hostile",
    [
        {"OPENBLAS_CORETYPE": "Sandybridge", "OPENBLAS_NUM_THREADS": "8", "OPENCV_IPP": "sse42"},
        {"NPY_DISABLE_CPU_FEATURES": "X86_V3", "OMP_NUM_THREADS": "7", "GOTO_NUM_THREADS": "5"},
        {"NPY_ENABLE_CPU_FEATURES": "X86_V3", "OPENCV_CPU_DISABLE": "AVX2"},
    ],
    ids=["blas", "numpy", "enabled"],
)
def test_variables_of_the_libraries_change_nothing(pinned: dict[str, str], hostile: dict[str, str]) -> None:
    assert words(**hostile) == pinned


def test_other_kernels_would_show_in_the_probe(pinned: dict[str, str]) -> None:
    """Without this, the tests above could not fail."""
    other = words("import numpy, scipy.linalg, cv2" + PROBE, OPENBLAS_CORETYPE="Sandybridge",
                  NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR")  # fmt: skip
    differing = {name for name in pinned if other[name] != pinned[name]}
    assert {"probe of numpy", "probe of OpenBLAS", "kernels of numpy"} <= differing


def test_a_tuned_c_library_shows_in_the_probe_and_a_command_starts_again(tmp_path: Path) -> None:
    tuned = {"GLIBC_TUNABLES": "glibc.malloc.check=0:glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"}
    assert words(**tuned)["probe of glibc"] != words()["probe of glibc"]
    assert words("from picktree.files import restart\nrestart()" + PROBE, **tuned) == words()


def test_what_else_is_tuned_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arithmetic, "_tuned", "")
    monkeypatch.setenv("GLIBC_TUNABLES", "glibc.malloc.check=3:glibc.cpu.x86_shstk=off")
    arithmetic.pin()
    assert os.environ["GLIBC_TUNABLES"] == "glibc.malloc.check=3"


@pytest.fixture
def unwarned(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(arithmetic, "_warned", False)
    arithmetic.missing_instructions.cache_clear()
    yield
    arithmetic.missing_instructions.cache_clear()


def test_numpy_before_picktree_is_warned_of_once() -> None:
    program = """
import json, os, warnings
import numpy
from picktree.files import arithmetic
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    arithmetic.check()
    arithmetic.check()
print(json.dumps([str(s.message) for s in said]))
"""
    said = words(program, OPENBLAS_CORETYPE="Sandybridge", OPENBLAS_NUM_THREADS="1")
    assert len(said) == 1
    (sentence,) = said
    assert sentence.startswith("numpy was imported before picktree and computes with other kernels (numpy")
    assert "OpenBLAS with Sandybridge, 1 thread" in sentence
    assert sentence.endswith(
        "): runs of this process may differ from those of the same seed elsewhere; import picktree first"
    )
    assert words(program, **arithmetic.PINNED) == [], "with the variables set, the order does not matter"


@pytest.mark.usefixtures("unwarned")
def test_a_processor_below_x86_64_v3_gets_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    old = tmp_path / "cpuinfo"
    old.write_text("processor\t: 0\nflags\t\t: fpu sse sse2 ssse3 sse4_2 avx f16c movbe abm bmi1\n")
    monkeypatch.setattr(arithmetic, "_PROCESSOR", old)
    with pytest.raises(PicktreeError) as raised:
        arithmetic.check()
    assert str(raised.value) == (
        "picktree simulates with the instructions of x86-64-v3 (Intel Haswell, AMD Zen and later), so that a "
        "seed gives the same run everywhere; this processor lacks avx2, bmi2, fma"
    )


@pytest.mark.usefixtures("unwarned")
def test_where_the_processor_cannot_be_read_nothing_is_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(arithmetic, "_PROCESSOR", tmp_path / "none")
    arithmetic.check()


def test_opencv_starts_no_threads_which_a_fork_would_wait_for() -> None:
    program = "import json, picktree, cv2\nprint(json.dumps({'threads': str(cv2.getNumThreads())}))"
    assert words(program, OPENCV_FOR_THREADS_NUM="4") == {"threads": "1"}
