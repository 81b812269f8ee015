"""Special functions against SciPy's, over their whole range, and against exact numbers."""

from decimal import Decimal, localcontext
from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest
from scipy import special as scipys

from wideberth.framework.numerics.special import (
    beta_quantile,
    carlson_rf,
    carlson_rg,
    normal_below,
    normal_quantile,
    upper_gamma,
    upper_gamma_quantile,
)
from wideberth.framework.values.arrays import Array
from wideberth.regions.log_normal_probability import _COEFFICIENTS

ULP = float(np.finfo(np.float64).eps)
TAILS = np.concatenate(
    [10.0 ** -np.linspace(0.01, 300.0, 2000), 1.0 - 10.0 ** -np.arange(1.0, 12)]
)
ORDERS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 10.0, 10.5, 60.0)


def apart(found: Array, wanted: Array) -> Array:
    """Relative distance in ulp."""
    return np.abs(found / wanted - 1.0) / ULP


def test_normal_distribution_is_scipys() -> None:
    """Its argument is rounded, which grows to x^2 ulp of what is as small as exp(-x^2 / 2)."""
    x = np.linspace(-37.0, 9.0, 5000)
    assert (apart(normal_below(x), scipys.ndtr(x)) < 4.0 + x**2).all()
    found = np.array([normal_quantile(tail) for tail in TAILS])
    assert apart(found, scipys.ndtri(TAILS)).max() < 8.0
    assert normal_quantile(0.0) == -np.inf and normal_quantile(1.0) == np.inf
    assert np.isnan(normal_below(np.nan)) and normal_below(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("order", ORDERS)
def test_upper_gamma_is_scipys(order: float) -> None:
    """SciPy's is off by up to 350 ulp, as the next test shows of an order that is whole."""
    x = np.concatenate([[0.0], np.geomspace(1e-12, 1.0, 100), np.linspace(1.0, 700.0, 2000)])
    wanted = scipys.gammaincc(order, x)
    seen = wanted > 1e-300
    assert (apart(upper_gamma(order, x), wanted)[seen] < 500.0 + 2.0 * x[seen]).all()
    far = upper_gamma(order, np.array([2000.0, 1e300, np.inf, np.nan]))
    assert (far[:3] == 0.0).all() and np.isnan(far[3])


@pytest.mark.parametrize("order", [1, 2, 3, 10, 60])
@pytest.mark.parametrize("x", [1e-9, 0.7, 5.0, 84.74, 300.0, 690.0])
def test_upper_gamma_is_its_sum(order: int, x: float) -> None:
    """In 50 digits."""
    with localcontext(prec=50):
        terms = (Decimal(x) ** k / factorial(k) for k in range(order))
        exact = float(sum(terms) * (-Decimal(x)).exp())
    assert upper_gamma(order, x) == pytest.approx(exact, rel=6.0 * ULP)
    half = float(scipys.erfc(np.sqrt(x)))
    assert upper_gamma(0.5, x) == pytest.approx(half, rel=(4.0 + 2.0 * x) * ULP)


@pytest.mark.parametrize("order", [*ORDERS, 150.5])
def test_quantile_of_upper_gamma_is_scipys(order: float) -> None:
    """The median of the distances as well: SciPy's own are off by up to 100 ulp at some tails."""
    tails = TAILS if order < 100 else TAILS[TAILS > 1e-30]
    found = upper_gamma_quantile(order, tails)
    off = apart(found, scipys.gammainccinv(order, tails))
    assert np.median(off) < 6.0 and off.max() < 100.0
    assert upper_gamma_quantile(order, 0.05).shape == ()


@pytest.mark.parametrize("share", [1e-300, 1e-30, 1e-6, 0.025, 0.5])
@pytest.mark.parametrize(("successes", "trials"), [(1, 1), (1, 30), (19, 20), (20, 20), (33, 100)])
def test_quantile_of_beta_solves_its_equation(successes: int, trials: int, share: float) -> None:
    """In whole numbers; of shares as small as 1e-300 the logarithm has 700 times the error."""
    found = beta_quantile(successes, trials - successes + 1, share)
    x = Fraction(found)
    ways = ((comb(trials, k), k) for k in range(successes, trials + 1))
    exact = sum(Fraction(many) * x**k * (1 - x) ** (trials - k) for many, k in ways)
    assert abs(float(exact / Fraction(share)) - 1.0) < ULP * (8.0 * successes + abs(np.log(share)))
    if share > 1e-7:
        wanted = scipys.betaincinv(successes, trials - successes + 1, share)
        assert found == pytest.approx(float(wanted), rel=20.0 * ULP)


@pytest.mark.parametrize("successes", [1, 400, 10_000, 19_999])
def test_quantile_of_beta_of_many_trials(successes: int) -> None:
    wanted = float(scipys.betaincinv(successes, 20_001 - successes, 0.025))
    assert beta_quantile(successes, 20_001 - successes, 0.025) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("decades", [0, 1, 6, 60, 120])
def test_carlsons_integrals_are_scipys(decades: int) -> None:
    rng = np.random.default_rng(decades)
    x, y, z = 10.0 ** rng.uniform(-decades, decades, (3, 2000))
    for one in (x, np.zeros(2000)):
        assert apart(carlson_rf(one, y, z), scipys.elliprf(one, y, z)).max() < 20.0
        assert (carlson_rf(y, z, one) == carlson_rf(one, y, z)).all()
        assert apart(carlson_rg(z, one, y), scipys.elliprg(z, one, y)).max() < 20.0


def test_carlsons_second_integral_of_flat_ellipsoids() -> None:
    assert carlson_rg(0.0, [0.0, 4.0, 0.0], [0.0, 0.0, 9.0]).tolist() == [0.0, 1.0, 1.5]
    assert carlson_rg(2.0, 2.0, 2.0) == pytest.approx(np.sqrt(2.0), rel=ULP)


def test_coefficients_of_the_scaled_error_function() -> None:
    """Those that Chebyshev's nodes give of SciPy's function."""
    nodes = np.polynomial.chebyshev.chebpts1(len(_COEFFICIENTS))
    x = 3.0 * (1.0 + nodes) / (1.0 - nodes)
    values = (1.0 + 2.0 * x) * scipys.erfcx(x)
    fitted = np.polynomial.chebyshev.chebfit(nodes, values, len(_COEFFICIENTS) - 1)
    np.testing.assert_allclose(_COEFFICIENTS, fitted, rtol=0.0, atol=1e-14)
