"""The quantile of chi-square against SciPy's distribution."""

import pytest
from scipy.stats import chi2

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.values.errors import WideberthError


@pytest.mark.parametrize("size", [1, 2, 3, 7, 40])
@pytest.mark.parametrize("tail", [1e-200, 1e-12, 0.05, 0.5, 0.999])
def test_content_bound_is_the_upper_quantile(size: int, tail: float) -> None:
    assert content_bound(size, tail) == pytest.approx(chi2.isf(tail, size), rel=1e-13)


@pytest.mark.parametrize("tail", [0.0, 1.0, float("nan")])
def test_a_tail_outside_its_range_is_refused(tail: float) -> None:
    with pytest.raises(WideberthError, match="tail"):
        content_bound(3, tail)
