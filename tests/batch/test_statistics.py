import math

import pytest

from picktree.apps.batch.comparison import paired_difference, unpaired_difference
from picktree.apps.batch.plan import parse_seeds
from picktree.apps.batch.rates import (
    difference_of_paired_rates,
    difference_of_rates,
    equal_rates_p,
    holm,
    paired,
)
from picktree.files import PicktreeError
from picktree.logs import CONFIDENCE, rate


@pytest.mark.parametrize(("successes", "total"), [(0, 1), (1, 1), (0, 7), (1, 7), (7, 7), (977, 1000)])
def test_wilsons_interval_is_that_of_scipy(successes: int, total: int) -> None:
    from scipy import stats  # loading takes half a second, which is no matter of the other tests

    theirs = stats.binomtest(successes, total).proportion_ci(CONFIDENCE, method="wilson")
    ours = rate(successes, total).interval
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)
    assert rate(successes, total).share == successes / total
    assert rate(0, 0).share is None


def test_mcnemar_counts_only_the_seeds_that_changed_sides() -> None:
    outcomes = [(True, True)] * 30 + [(True, False)] * 9 + [(False, True)] * 1
    found = paired(outcomes)
    assert (found.both, found.only_a, found.only_b, found.neither) == (30, 9, 1, 0)
    assert found.p_value == pytest.approx(2 * (1 + 10) / 2**10)
    assert paired([(True, True)] * 5).p_value == 1.0


def test_newcombes_interval_for_independent_rates_is_the_published_one() -> None:
    # Newcombe 1998, Stat. Med. 17:873, table II: 56/70 against 48/80 by method 10: 0.0524 to 0.3339.
    found = difference_of_rates(rate(48, 80), rate(56, 70))
    assert (found.low, found.high) == pytest.approx((0.0524, 0.3339), abs=1e-4)


def test_newcombes_interval_for_paired_rates_is_the_published_one() -> None:
    # Newcombe 1998, Stat. Med. 17:2635, method 10: a 20, b 12, c 2, d 16 gives 0.0562 to 0.3292.
    outcomes = [(True, True)] * 20 + [(False, True)] * 12 + [(True, False)] * 2 + [(False, False)] * 16
    found = difference_of_paired_rates(paired(outcomes))
    assert (found.low, found.high) == pytest.approx((0.0562, 0.3292), abs=1e-4)
    same = difference_of_paired_rates(paired([(True, True)] * 10))
    assert (same.low, same.high) == pytest.approx((-0.278, 0.278), abs=1e-3)


def test_the_exact_test_of_independent_rates_is_stronger_than_fishers() -> None:
    # Mehrotra et al. 2003: 7 of 15 against 12 of 15 by Boschloo's test.
    p_value = equal_rates_p(rate(12, 15), rate(7, 15))
    assert p_value == pytest.approx(0.0680, abs=1e-3)
    assert equal_rates_p(rate(5, 5), rate(9, 9)) == 1.0
    assert equal_rates_p(rate(0, 0), rate(9, 9)) == 1.0
    assert equal_rates_p(rate(300, 300), rate(280, 300)) < 1e-5  # many jobs: Fisher


def test_holm_keeps_the_order_and_never_says_less() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx((0.03, 0.06, 0.06))
    assert holm([0.5, 0.9]) == (1.0, 1.0)
    assert holm([]) == ()


def test_a_paired_difference_is_judged_by_swapping_within_pairs() -> None:
    slower = paired_difference([(float(k), k + 1.0 + 0.1 * (k % 3)) for k in range(30)])
    assert slower.mean == pytest.approx(1.1)
    assert 1.0 < slower.interval.low < slower.interval.high < 1.2
    assert slower.p_value < 0.001
    # All five that changed went one way: 2 of 2⁵ splits are as extreme.
    assert paired_difference([(0.0, 1.0)] * 5 + [(0.0, 0.0)] * 9).p_value == pytest.approx(2 / 2**5)
    assert paired_difference([(0.0, (-1.0) ** k) for k in range(30)]).p_value > 0.9
    one = paired_difference([(1.0, 2.0)])
    assert (one.p_value, one.interval.high) == (1.0, math.inf)  # one pair tells nothing
    assert paired_difference([]).a is None


def test_an_unpaired_difference_is_judged_by_handing_out_anew() -> None:
    # 3 against 3, wholly apart: 2 of 20 ways to hand them out are as extreme.
    apart = unpaired_difference([1.0, 2.0, 3.0], [11.0, 12.0, 13.0])
    assert (apart.mean, apart.p_value) == (10.0, pytest.approx(2 / 20))
    assert apart.interval.low > 5
    same = unpaired_difference([4.0] * 9, [4.0] * 7)
    assert (same.p_value, same.interval.low, same.interval.high, same.count) == (1.0, 0.0, 0.0, 7)
    assert unpaired_difference([], [1.0]).p_value == 1.0


@pytest.mark.parametrize(
    ("text", "seeds"), [("0:3", (0, 1, 2)), ("5", (5,)), ("3, 7, 5:8", (3, 7, 5, 6)), ("1,1:3", (1, 2))]
)
def test_seeds_are_half_open_ranges_and_numbers(text: str, seeds: tuple[int, ...]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "seeds '': '' is not a seed; write 0:100 (half open), 3,7 or both"),
        ("4:4", "seeds '4:4': the range '4:4' is empty: write 0:100 (half open), 3,7 or both"),
        ("-1:3", "seeds '-1:3': a seed is 0 or more, and at most 2147483647"),
        ("0:1000000", "seeds '0:1000000': more than 100000 seeds"),
    ],
)
def test_other_words_are_no_seeds(text: str, message: str) -> None:
    with pytest.raises(PicktreeError) as refused:
        parse_seeds(text)
    assert str(refused.value) == message
