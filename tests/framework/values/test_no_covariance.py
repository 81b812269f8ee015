"""What is no covariance is refused with one message, or named where a sensor reports it."""

from collections.abc import Callable

import numpy as np
import pytest

from wideberth.framework.risk import collision_probability as risk
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, GaussianObstacle
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics import episode as metrics
from wideberth.metrics import plan as metrics_plan
from wideberth.metrics import scoring
from wideberth.regions.box import box_content
from wideberth.regions.static.packing import pack
from wideberth.tests.oracles import risk_bounds

Asked = Callable[[np.ndarray], object]

APART = np.array([2.0, 1.0])
POINT, MODES = np.zeros((1, 1, 2)), np.zeros((1, 1, 1, 2))
ONE, DRAWS = np.ones((1, 1)), np.zeros((3, 1, 1, 2))
TRIANGLE = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]


def one(covariance: np.ndarray) -> np.ndarray:
    """Of one forecast with one mode and one step."""
    return np.asarray(covariance)[None, None, None]


TAKERS: dict[str, Asked] = {
    "probability": lambda s: risk.collision_probability(APART, s, 1.0),
    "half_plane_level": lambda s: risk_bounds.half_plane_level(APART, s, 1.0),
    "half_plane_bound": lambda s: risk_bounds.half_plane_bound(APART, s, 1.0),
    "centre_point_value": lambda s: risk_bounds.centre_point_value(APART, s, 1.0),
    "highest_density_bound": lambda s: risk_bounds.highest_density_bound(APART, s, 1.0),
    "centre_line_bound": lambda s: risk_bounds.centre_line_bound(APART, s, 1.0),
    "box_bound": lambda s: risk_bounds.box_bound(APART, s, 1.0),
    "squared_mahalanobis": lambda s: metrics.squared_mahalanobis(APART, s, APART),
    "inside_content": lambda s: metrics.inside_content(APART, s, APART, 0.05),
    "coverage": lambda s: metrics.coverage(POINT, np.asarray(s)[None, None], POINT, 0.05),
    "content_area": lambda s: metrics_plan.content_area(np.asarray(s), 0.05),
    "outside_content": lambda s: metrics_plan.outside_content(APART, s, APART, np.array(0.9)),
    "plan_risk": lambda s: metrics_plan.plan_risk(POINT[0], MODES, one(s), ONE, np.ones(1)),
    "log_density": lambda s: scoring.log_density(MODES, one(s), ONE, POINT),
    "reached_tail": lambda s: scoring.reached_tail(MODES, one(s), ONE, POINT),
    "region_area": lambda s: scoring.region_area(MODES, one(s), ONE, 0.05),
    "box_content": lambda s: box_content(np.ones(2), s),
    "static_region": lambda s: pack(np.array(TRIANGLE), np.array(0.1), s),
    "obstacle": lambda s: GaussianObstacle(APART, s),
    "forecast": lambda s: Forecast(MODES, one(s), ONE, 0.5, (None,)),
    "tracks": lambda s: Tracks(POINT, 0.5, ("a",), np.ones(1), np.asarray(s)[None]),
}

REPORTERS: dict[str, Callable[[np.ndarray], Detection | Observation]] = {
    "detection": lambda s: Detection("a", APART, s, 0.3),
    "observation": lambda s: Observation(0.0, APART, covariance=s),
}
"""What a sensor may report at any time: wrong numbers are named in it, wrong shapes refused."""

NO_COVARIANCES = {
    "negative": -np.eye(2),
    "indefinite": np.array([[1.0, 2.0], [2.0, 1.0]]),
    "indefinite beyond rounding": np.diag([1.0, -1e-8]),
    "asymmetric": np.array([[1.0, 0.5], [0.0, 1.0]]),
    "asymmetric beyond rounding": np.array([[1.0, 0.5], [0.5 + 1e-8, 1.0]]),
    "asymmetric and huge": np.array([[1e308, 1e308], [-1e308, 1e308]]),
    "nan": np.array([[1.0, np.nan], [np.nan, 1.0]]),
    "infinite": np.diag([1.0, np.inf]),
    "shape": np.ones((2, 3)),
}


def words_for(name: str) -> str:
    """What the message says of a matrix."""
    words = {"nan": "finite", "infinite": "finite", "shape": "shape"}
    kind = "not symmetric" if name.startswith("asymmetric") else "positive semi-definite"
    return words.get(name, kind)


def refusal(taker: Asked, covariance: np.ndarray) -> str:
    try:
        taker(covariance)
    except WideberthError as error:
        return str(error)
    return "taken"


@pytest.mark.parametrize("taker", TAKERS)
def test_what_is_no_covariance_is_refused(taker: str) -> None:
    said = {name: refusal(TAKERS[taker], one) for name, one in NO_COVARIANCES.items()}
    assert {name: words for name, words in said.items() if words_for(name) not in words} == {}


@pytest.mark.parametrize("reporter", REPORTERS)
def test_what_a_sensor_reports_is_named(reporter: str) -> None:
    assert "shape" in refusal(REPORTERS[reporter], NO_COVARIANCES["shape"])
    for name in NO_COVARIANCES.keys() - {"shape"}:
        assert words_for(name) in REPORTERS[reporter](NO_COVARIANCES[name]).flaw, name


@pytest.mark.parametrize("reporter", REPORTERS)
def test_rounding_is_no_flaw(reporter: str) -> None:
    assert REPORTERS[reporter](np.array([[1.0, 0.5], [0.5 + 1e-15, 0.4]])).flaw == ""


@pytest.mark.parametrize("taker", TAKERS)
def test_rounding_is_forgiven(taker: str) -> None:
    exact = TAKERS[taker](np.array([[1.0, 0.5], [0.5, 0.4]]))
    rounded = TAKERS[taker](np.array([[1.0, 0.5], [0.5 + 1e-15, 0.4]]))
    if isinstance(exact, np.ndarray | float):
        np.testing.assert_allclose(rounded, exact, rtol=1e-12)


def test_a_singular_covariance_is_one() -> None:
    """Rounded to an eigenvalue just below zero as well."""
    for lowest in (0.0, -1e-12):
        got = risk.collision_probability([0.5, 0.0], np.diag([1.0, lowest]), 1.0)
        assert 0.0 < float(got) < 1.0
    for magnitude in (1e-300, 1e-200, 1e200, 1e300):
        GaussianObstacle(APART, magnitude * np.array([[1.0, 0.5], [0.5, 1.0]]))
        with pytest.raises(WideberthError, match="positive semi-definite"):
            GaussianObstacle(APART, magnitude * np.array([[1.0, 2.0], [2.0, 1.0]]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("a", np.eye(2), 1.0), "arrays of numbers"),
        (([1.0, 1.0], [[1.0, 2.0], [3.0]], 1.0), "arrays of numbers"),
        ((np.zeros((3, 2)), np.tile(np.eye(2), (4, 1, 1)), 1.0), "one batch"),
        ((np.zeros((3, 2)), np.eye(2), np.ones(2)), "one batch"),
        ((np.zeros(4), np.eye(4), 1.0), "D = 2 or 3"),
        ((APART, np.eye(2), -1.0), "at least 0 m"),
    ],
)
def test_pairs_that_do_not_fit_are_refused(given: tuple[object, ...], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        risk.collision_probability(*given)  # type: ignore[arg-type]


def test_three_dimensions_are_checked_as_well() -> None:
    with pytest.raises(WideberthError, match=r"covariance\[1\] has eigenvalue -1"):
        risk.collision_probability(np.ones(3), np.stack([np.eye(3), np.diag([1, 1, -1])]), 1.0)
