"""One arithmetic: the same floating-point kernels in every process, on any processor from x86-64-v3 on.

numpy, OpenBLAS, OpenCV and glibc choose their kernels by the processor, and each choice rounds the last bit
in its own way. A simulated contact amplifies that bit: the same seed then gives another run. So each library
is held to the kernels that every x86-64-v3 processor has (AVX2 and FMA: Intel Haswell, AMD Zen, and later).

The libraries read their variables once, when they are loaded, and glibc reads its own before Python begins.
Therefore `picktree/__init__.py` calls `pin` before anything else is imported, and child processes inherit the
variables. `restart` is for commands: it starts a process again that glibc has tuned otherwise.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

from .errors import PicktreeError

PINNED: Final[Mapping[str, str]] = {
    # Kernels of numpy beyond x86-64-v3; the sums and transcendental functions differ there.
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    # The kernels of matrix products and of LAPACK, in the copies of numpy, scipy and OpenCV.
    "OPENBLAS_CORETYPE": "Haswell",
    # Several threads split a product, so its sums would depend on the number of cores.
    "OPENBLAS_NUM_THREADS": "1",
    # Intel's primitives inside of OpenCV.
    "OPENCV_IPP": "avx2",
    # A process with a pool of threads cannot be forked, and batches fork one for each job.
    "OPENCV_FOR_THREADS_NUM": "1",
}
"""Environment variables of the libraries, with the value that every simulating process has."""
REMOVED: Final = ("NPY_ENABLE_CPU_FEATURES", "OPENCV_CPU_DISABLE")
"""Environment variables that would choose other kernels; numpy refuses to start with the first of them."""
TUNABLES: Final = "GLIBC_TUNABLES"
_CPU_TUNABLES: Final = "glibc.cpu."
_V3: Final = ("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe")
"""Flags of x86-64-v3 as Linux names them; `abm` is the flag of lzcnt."""
_PROCESSOR: Final = Path("/proc/cpuinfo")

_numpy_came_first = "numpy" in sys.modules
_tuned = ""
"""The variable of glibc with which this process was started, where it chooses kernels."""
_warned = False


def pin() -> None:
    """Set the variables of the libraries that are not loaded yet, here and for all child processes.

    A processor without AVX2 keeps the kernels that the libraries choose, so that the import of numpy does not
    crash; `check` refuses to simulate there.
    """
    global _tuned
    tunables = os.environ.get(TUNABLES, "")
    others = ":".join(part for part in tunables.split(":") if not part.startswith(_CPU_TUNABLES))
    if others != tunables:
        _tuned = tunables
        os.environ.pop(TUNABLES)
        if others:
            os.environ[TUNABLES] = others
    for name in REMOVED:
        os.environ.pop(name, None)
    if not missing_instructions():
        os.environ.update(PINNED)


def restart(before: Callable[[], object] = lambda: None) -> None:
    """Restart this process when glibc was set to choose other kernels; else return at once.

    Commands call it first. The new process has the same arguments, files and process id. `before` is called
    just before the restart.
    """
    if _tuned:
        before()
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], os.environ)


def check() -> None:
    """Warn once when this process computes with other kernels.

    Raises PicktreeError on a processor below x86-64-v3.
    """
    missing = missing_instructions()
    if missing:
        raise PicktreeError(
            "picktree simulates with the instructions of x86-64-v3 (Intel Haswell, AMD Zen and later), so "
            f"that a seed gives the same run everywhere; this processor lacks {', '.join(missing)}"
        )
    global _warned
    if _warned:
        return
    _warned = True
    for sentence in _warnings():
        warnings.warn(sentence, RuntimeWarning, stacklevel=3)


@cache
def missing_instructions() -> tuple[str, ...]:
    """Return the instructions of x86-64-v3 that the processor lacks; empty when they cannot be read."""
    try:
        with _PROCESSOR.open(encoding="ascii", errors="replace") as lines:
            flags = next((line.split() for line in lines if line.startswith("flags")), None)
    except OSError:
        return ()
    return () if flags is None else tuple(flag for flag in _V3 if flag not in flags)


def numpy_kernels() -> str:
    """Return the highest instruction set of numpy's active kernels, such as `X86_V3`. Loads numpy."""
    import numpy as np

    config = cast("dict[str, Any]", np.show_config(mode="dicts") or {})
    found = cast("list[str]", config.get("SIMD Extensions", {}).get("found", []))
    return found[-1] if found else "baseline"


def blas_kernels() -> Mapping[str, str]:
    """Return the kernels of each OpenBLAS in this process by its package, such as `Haswell, 1 thread`."""
    from threadpoolctl import threadpool_info

    return {
        Path(str(library["filepath"])).parent.name.partition(".")[0]: _core(library)
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }


def _core(library: Mapping[str, Any]) -> str:
    threads = int(library["num_threads"])
    return f"{library.get('architecture', 'unknown')}, {threads} thread{'' if threads == 1 else 's'}"


def departures() -> Mapping[str, str]:
    """Return the reasons why this process computes with other kernels, by library; empty when it does not."""
    found: dict[str, str] = {}
    if _tuned:
        found["glibc"] = f"started with {TUNABLES}={_tuned}"
    if _other_kernels():
        found["numpy"] = "imported before picktree"
    return found


def _other_kernels() -> list[str]:
    """Return the kernels of libraries that were loaded before `pin`, where they are others."""
    if not _numpy_came_first:
        return []
    wanted = f"{PINNED['OPENBLAS_CORETYPE']}, {PINNED['OPENBLAS_NUM_THREADS']} thread"
    kernels = {"numpy": numpy_kernels(), **{f"{name}'s OpenBLAS": k for name, k in blas_kernels().items()}}
    return [f"{name} with {k}" for name, k in kernels.items() if k not in ("X86_V3", wanted)]


def _warnings() -> Iterator[str]:
    if _tuned:
        yield (
            f"{TUNABLES}={_tuned} makes the C library compute with other kernels: runs of this process may "
            "differ from those of the same seed elsewhere; start Python without this variable"
        )
    others = _other_kernels()
    if others:
        yield (
            f"numpy was imported before picktree and computes with other kernels ({'; '.join(others)}): runs "
            "of this process may differ from those of the same seed elsewhere; import picktree first"
        )
