"""The risk of decisions made from draws: its equation, and decisions whose risk is known."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from scipy.stats import beta, binom

from wideberth.controllers.slots.scenario_risk import (
    largest_support,
    risk_of_support,
    scenarios_wanted,
)


@pytest.mark.parametrize(("support", "scenarios"), [(0, 30), (3, 40), (12, 60), (39, 40)])
def test_the_risk_solves_its_equation(support: int, scenarios: int) -> None:
    """In whole numbers: the two sides change places within 1e-8 of the root."""
    doubt = Fraction(1, 50)

    def excess(risk: float) -> Fraction:
        keep = 1 - Fraction(risk)
        terms = (comb(m, support) * keep ** (m - support) for m in range(support, scenarios))
        right = comb(scenarios, support) * keep ** (scenarios - support)
        return doubt / scenarios * sum(terms) - right

    found = risk_of_support(support, scenarios, float(doubt))
    assert excess(found - 1e-8) < 0 < excess(found + 1e-8)


def test_all_draws_hold_the_decision_or_none_does() -> None:
    assert risk_of_support(20, 20, 0.01) == 1.0
    # without a holder the decision was made before the draws, all of which then keep it
    assert 1.0 - 0.01 ** (1 / 500) < risk_of_support(0, 500, 0.01) < 0.015


def test_largest_support_and_fewest_scenarios_are_inverse() -> None:
    for risk, scenarios, doubt in ((0.05, 1000, 0.01), (0.1, 385, 0.01), (0.2, 150, 1e-3)):
        most = largest_support(risk, scenarios, doubt)
        assert risk_of_support(most, scenarios, doubt) <= risk
        assert risk_of_support(most + 1, scenarios, doubt) > risk
        wanted = scenarios_wanted(risk, most, doubt)
        assert wanted <= scenarios
        assert risk_of_support(most, wanted, doubt) <= risk
        assert risk_of_support(most, wanted - 1, doubt) > risk
    assert largest_support(0.01, 20, 0.01) == -1


@pytest.mark.parametrize("sides", [1, 4, 12])
def test_boxes_around_draws_risk_no_more_but_for_the_doubt(sides: int) -> None:
    """The box [0, max] in d dimensions around draws of the unit cube leaves 1 - prod max."""
    rng, scenarios, doubt, runs = np.random.default_rng(4), 100, 0.1, 4000
    broken = 0
    for _ in range(runs):
        draws = rng.random((scenarios, sides))
        support = len(np.unique(draws.argmax(axis=0)))
        broken += 1.0 - draws.max(axis=0).prod() > risk_of_support(support, scenarios, doubt)
    assert broken <= binom.ppf(0.999, runs, doubt)


def test_the_risk_is_close_to_that_of_a_support_known_beforehand() -> None:
    """Which is exact, see Campi, Garatti 2008, and a support of 0 .. S has to be paid for."""
    for support, scenarios in ((5, 500), (20, 1000)):
        known = float(beta.ppf(0.99, support, scenarios - support + 1))
        assert known < risk_of_support(support, scenarios, 0.01) < 1.5 * known


def test_it_is_below_the_older_bound() -> None:
    for support in (1, 10, 40):
        older = 1.0 - (0.01 / (1000 * comb(1000, support))) ** (1.0 / (1000 - support))
        assert risk_of_support(support, 1000, 0.01) < older
