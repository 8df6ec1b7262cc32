"""Arithmetic of this process: versions, kernels, and a probe that differs in the last bit for another one."""

from __future__ import annotations

import hashlib
import math
import os
import platform
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from picktree.files import blas_kernels, departures, library_parts, numpy_kernels
from picktree.logs import arithmetic_record

_PACKAGES: Final = {
    "numpy": "numpy",
    "scipy": "scipy",
    "pybullet": "pybullet",
    "pinocchio": "pin",
    "coal": "coal",
    "OpenCV": "opencv-python-headless",
}
"""Numerical libraries, with the distributions that contain them."""
_Numbers: TypeAlias = NDArray[np.float64]
_Results: TypeAlias = list[NDArray[Any]]


@cache
def arithmetic() -> arithmetic_record.Arithmetic:
    """Return the arithmetic of this process. The probe takes about 20 ms of CPU, once."""
    numbers = _numbers()
    probes = {name: _fingerprint(probe(numbers.copy())) for name, probe in _PROBES.items()}  # loads kernels
    kernels = {"numpy": numpy_kernels(), **{f"OpenBLAS in {k}": v for k, v in sorted(blas_kernels().items())}}
    return arithmetic_record.Arithmetic(_versions(), kernels, probes, departures())


def _versions() -> dict[str, str]:
    blas = (
        cast("dict[str, Any]", np.show_config(mode="dicts") or {})
        .get("Build Dependencies", {})
        .get("blas", {})
    )
    return {
        **{name: library_parts.library_version(package) for name, package in _PACKAGES.items()},
        "OpenBLAS": str(blas.get("version", "unknown")),
        "glibc": (os.confstr("CS_GNU_LIBC_VERSION") or "unknown").removeprefix("glibc "),
        "Python": platform.python_version(),
    }


def _fingerprint(results: _Results) -> str:
    """Return the beginning of a SHA-256 over the bytes of the results of one probe."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in results)).hexdigest()[:16]


def _numbers() -> _Numbers:
    """Return 4096 numbers in (-1, 1), exact in binary, without regularity: a linear congruence (Lehmer
    1951)."""
    state, numbers = 1, np.empty(4096)
    for n in range(numbers.size):
        state = state * 48271 % 2147483647
        numbers[n] = state / 2**30 - 1.0
    return numbers


def _libm(x: _Numbers) -> _Results:
    functions = (
        math.sin,
        math.cos,
        math.tan,
        math.atan,
        math.exp,
        math.tanh,
        math.sinh,
        math.cbrt,
        math.log1p,
    )
    values = x[:256].tolist()
    pairs = zip(values, reversed(values), strict=True)
    return [
        np.array([[f(3.7 * v if f is not math.log1p else v) for v in values] for f in functions]),
        np.array([(math.atan2(a, b), math.hypot(a, b), math.pow(abs(a), b)) for a, b in pairs]),
        np.array([(math.acos(v), math.asin(v), math.log(abs(v)), math.sqrt(abs(v))) for v in values]),
    ]


def _numpy(x: _Numbers) -> _Results:
    positive = np.abs(x) + 1e-3
    single = x.astype(np.float32)
    middle = np.partition(x, (2047, 2048))[2047:2049]  # of it np.median, which loads numpy.ma, takes the mean
    return [
        *(f(3.7 * x) for f in (np.sin, np.cos, np.tan, np.exp, np.tanh, np.arctan, np.sinh, np.cbrt)),
        *(f(x) for f in (np.arcsin, np.arccos, np.log1p, np.expm1)),
        *(f(positive) for f in (np.log, np.log2, np.sqrt, np.reciprocal)),
        np.arctan2(x, x[::-1]),
        np.hypot(x, x[::-1]),
        np.power(positive, x),
        np.array([x.sum(), x.mean(), x.std(), middle.mean(), x[::3].sum(), float(single.sum())]),
        x.reshape(64, 64).sum(axis=0),
        np.cumsum(x),
        np.sin(single).astype(float),
        np.linalg.norm(x.reshape(-1, 4), axis=1),
        np.einsum("ij,kj->ik", x.reshape(64, 64)[:9], x.reshape(64, 64)[9:18]),
        np.sort(x),
    ]


def _blas(x: _Numbers) -> _Results:
    matrix = x.reshape(64, 64)
    small = matrix[:7, :7]
    definite = matrix @ matrix.T + 8.0 * np.eye(64)
    tall = x[:2400].reshape(800, 3)
    return [
        matrix @ matrix,
        small @ small.T,
        matrix @ x[:64],
        np.array([x @ x[::-1], x[:1001] @ x[1:1002]]),
        tall.T @ tall,
        np.linalg.solve(matrix, x[:64]),
        np.linalg.inv(small),
        np.linalg.cholesky(definite),
        np.linalg.eigh(definite)[0],
        np.linalg.svd(tall - tall.mean(axis=0), full_matrices=False)[2],
        np.linalg.lstsq(tall, x[:800], rcond=None)[0],
        np.linalg.qr(matrix[:, :6])[0],
    ]


def _lapack(x: _Numbers) -> _Results:
    """Compute with scipy's copy of LAPACK; planning uses the last two of these functions."""
    names = ("dgesv", "dgetrf", "dposv", "dgtsv")
    solve, factorise, descend, curve = (
        library_parts.library_part("scipy.linalg._flapack", f"scipy.linalg.lapack.{name}") for name in names
    )
    matrix = x.reshape(64, 64)
    definite = matrix[:6] @ matrix[:6].T + np.eye(6)
    return [
        solve(matrix, x[:64])[2],
        factorise(matrix)[0],
        descend(definite, x[:6])[1],
        curve(x[:9] / 4, x[9:19] + 4, x[19:28] / 4, x[28:98].reshape(10, 7))[3],
    ]


def _opencv(x: _Numbers) -> _Results:
    cv2: Any = import_module("cv2")
    picture = np.ascontiguousarray(x.reshape(64, 64).astype(np.float32))
    mask = (picture > 0.2).astype(np.uint8)
    points = picture.reshape(-1, 2)[:200]
    return [
        cv2.blur(picture, (5, 5)),
        cv2.medianBlur(picture, 5),
        cv2.distanceTransform(mask, cv2.DIST_L2, 5),
        np.array(cv2.minAreaRect(points)[1]),
        cv2.convexHull(points),
    ]


def _pinocchio(x: _Numbers) -> _Results:
    pin: Any = import_module("pinocchio")
    model = pin.buildSampleModelManipulator()
    data = model.createData()
    q = pin.integrate(model, pin.neutral(model), x[: model.nv])
    v, a = x[10 : 10 + model.nv], x[20 : 20 + model.nv]
    return [
        np.array(pin.rnea(model, data, q, v, a)),
        np.array(pin.computeJointJacobians(model, data, q)),
        np.array(pin.crba(model, data, q)),
    ]


def _coal(x: _Numbers) -> _Results:
    coal: Any = import_module("coal")
    box, capsule = coal.Box(0.2, 0.1, 0.3), coal.Capsule(0.05, 0.2)

    def distance(n: int) -> float:
        place = coal.Transform3s(np.eye(3), 0.5 + x[n : n + 3])
        return coal.distance(
            box, coal.Transform3s(), capsule, place, coal.DistanceRequest(), coal.DistanceResult()
        )

    return [np.array([distance(n) for n in range(0, 60, 6)])]


_PROBES: Final[Mapping[str, Callable[[_Numbers], _Results]]] = {
    "glibc": _libm,
    "numpy": _numpy,
    "OpenBLAS": _blas,
    "LAPACK in scipy": _lapack,
    "OpenCV": _opencv,
    "pinocchio": _pinocchio,
    "coal": _coal,
}
