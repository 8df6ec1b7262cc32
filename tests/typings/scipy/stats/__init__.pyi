from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

class ConfidenceInterval:
    low: float
    high: float

class BinomTestResult:
    pvalue: float
    def proportion_ci(
        self, confidence_level: float = ..., method: Literal["exact", "wilson", "wilsoncc"] = ...
    ) -> ConfidenceInterval: ...

def binomtest(
    k: int, n: int, p: float = ..., alternative: Literal["two-sided", "greater", "less"] = ...
) -> BinomTestResult: ...

class BootstrapResult:
    confidence_interval: ConfidenceInterval
    standard_error: float

def bootstrap(
    data: Sequence[NDArray[np.float64]],
    statistic: Callable[..., Any],
    *,
    n_resamples: int = ...,
    confidence_level: float = ...,
    method: str = ...,
    vectorized: bool | None = ...,
    rng: np.random.Generator | None = ...,
) -> BootstrapResult: ...

class PermutationTestResult:
    pvalue: float

def permutation_test(
    data: Sequence[NDArray[np.float64]],
    statistic: Callable[..., Any],
    *,
    permutation_type: str = ...,
    vectorized: bool | None = ...,
    n_resamples: int = ...,
    rng: np.random.Generator | None = ...,
) -> PermutationTestResult: ...

class SignificanceResult:
    statistic: float
    pvalue: float

def fisher_exact(table: Sequence[Sequence[int]]) -> SignificanceResult: ...
def boschloo_exact(table: Sequence[Sequence[int]]) -> SignificanceResult: ...

class DegenerateDataWarning(RuntimeWarning): ...
