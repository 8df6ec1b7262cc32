import pytest

from picktree.batch.seeds import parse_seeds
from picktree.batch.statistics import difference, paired, rate
from picktree.world.errors import PicktreeError


def test_wilsons_interval_is_that_of_the_textbook() -> None:
    found = rate(15, 20)
    assert found.share == 0.75
    # (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n), z = 1.959964
    assert found.interval.low == pytest.approx(0.53129, abs=1e-5)
    assert found.interval.high == pytest.approx(0.88814, abs=1e-5)
    assert rate(0, 0).share is None


def test_mcnemar_counts_only_the_seeds_that_changed_sides() -> None:
    outcomes = [(True, True)] * 30 + [(True, False)] * 9 + [(False, True)] * 1
    found = paired(outcomes)
    assert (found.both, found.only_a, found.only_b, found.neither) == (30, 9, 1, 0)
    assert found.p_value == pytest.approx(2 * (1 + 10) / 2**10)
    assert paired([(True, True)] * 5).p_value == 1.0


def test_a_clear_difference_is_clear_and_none_is_not() -> None:
    slower = difference([(float(k), k + 1.0 + 0.1 * (k % 3)) for k in range(30)])
    assert slower.clear and slower.mean == pytest.approx(1.1)
    assert 1.0 < slower.interval.low < slower.interval.high < 1.2
    assert not difference([(0.0, (-1.0) ** k) for k in range(30)]).clear
    assert not difference([(1.0, 2.0)]).clear  # one pair tells nothing
    assert difference([(1.0, 2.0)] * 3).clear


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("0:3", (0, 1, 2)), ("5", (5,)), ("3, 7, 5:8", (3, 7, 5, 6)), ("1,1:3", (1, 2))],
)
def test_seeds_are_half_open_ranges_and_numbers(text: str, seeds: tuple[int, ...]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "seeds '': '' is no seed; write 0:100 (half open), 3,7 or both"),
        ("4:4", "seeds '4:4': '4:4' holds no seed: write 0:100 (half open), 3,7 or both"),
        ("-1:3", "seeds '-1:3': a seed is 0 or more, and at most 2147483647"),
        ("0:1000000", "seeds '0:1000000': more than 100000 seeds"),
    ],
)
def test_other_words_are_no_seeds(text: str, message: str) -> None:
    with pytest.raises(PicktreeError) as refused:
        parse_seeds(text)
    assert str(refused.value) == message
