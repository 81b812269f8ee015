"""The paper's predictor: a vector autoregression on each obstacle's velocities."""

import warnings
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, Literal, NamedTuple, final

import numpy as np

from ..framework.arrays import Array, positive, whole
from ..framework.errors import WideberthError
from ..framework.forecast import Forecast, Scene
from ..framework.predictor import Predictor
from ..framework.tracks import Tracks
from .assembly import Gaussians, with_fallback
from .history import gather, measurement_noise
from .kalman import Kalman
from .velocity_process import (
    Integration,
    VelocityProcess,
    differenced_noise,
    displacements,
    estimation_joint,
    exact_joint,
    forecast_velocities,
    paper_covariances,
)

CONDITION = 1e6
"""Largest condition number of the regressors Z that the gate lets pass."""
ROUNDING = 1e12
"""Largest condition number without the gate: above it least squares fits rounding errors."""
FREEDOM = 4
"""Fewest residual degrees of freedom that the gate lets pass."""
REACH = 1e6
"""m; a forecast that leaves this radius has overflowed in all but name, gate or no gate."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted process and what its quality is judged by.

    Attributes
    ----------
    process : coefficients, intercept, innovation covariance.
    moment_inverse : (Z'Z)^-1, (K, K), unit (m/s)^-2 (the intercept apart).
    condition : largest over smallest singular value of Z.
    freedom : residual degrees of freedom of each equation.
    """

    process: VelocityProcess
    moment_inverse: Array
    condition: float
    freedom: int


def fit_velocities(velocities: Array, order: int, trend: Literal["n", "c"]) -> Fit | str:
    """Fit a VAR by least squares (statsmodels), or say why it cannot be done.

    Parameters
    ----------
    velocities : (T, D), m/s, oldest first.
    order : p.
    trend : "n" without, "c" with an intercept.
    """
    from statsmodels.tsa.api import VAR

    count, size = velocities.shape
    extra = int(trend == "c")
    freedom = count - order - order * size - extra
    if freedom < 1:
        return f"{freedom} residual degrees of freedom"
    # statsmodels and NumPy warn of what the gate below judges; a warning is no answer.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            result = VAR(velocities).fit(maxlags=order, trend=trend)
            regressors = np.asarray(result.endog_lagged)
            singular = np.linalg.svd(regressors, compute_uv=False)
            inverse = np.linalg.pinv(regressors)
            innovation = np.asarray(result.sigma_u)
        except (ValueError, np.linalg.LinAlgError) as error:
            return f"statsmodels: {error}"
        condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")
    intercept = np.asarray(result.params)[0] if extra else np.zeros(size)
    innovation = 0.5 * (innovation + innovation.T)
    process = VelocityProcess(np.asarray(result.coefs), innovation, intercept)
    return Fit(process, inverse @ inverse.T, condition, freedom)


class _Past(NamedTuple):
    """The history of one obstacle."""

    origin: Array
    positions: Array
    samples: int
    late: int


@final
@dataclass(frozen=True)
class VectorAutoregression(Predictor):
    """VAR(2) on world-frame velocities, fitted to each obstacle's own history.

    v_{h} = c + A_1 v_{h-1} + A_2 v_{h-2} + u_h,   u_h ~ N(0, Sigma_u)

    with v_k = (p_k - p_{k-1}) / dT, fitted by statsmodels at every call. Positions follow
    by summing velocities up, their covariance by ``covariance``:

    - "paper-literal", "paper": the paper's recursion as printed, and with its index mended
      (see `paper_covariances`). Both neglect covariances between successive velocities: a
      nominal 95 % ellipse covers 13 % at step 15 where velocities persist, and 51 % on
      average on recorded people.
    - "exact": the covariance that the fitted process has (95 % where the process is true).
    - "exact+estimation" (default): and that of the fitted coefficients (`estimation_joint`).

    The paper integrates by the trapezoid rule; with backward differences the rectangle rule
    is exact, and the trapezoid halves the deviation of the first step. The paper's own is
    ``VectorAutoregression(covariance="paper", integration="trapezoid", gate=False)``.

    The start covariance is that of the measured positions (``tracks.noise`` plus
    ``noise_floor``^2 I), whose errors p_k shares with v_k and v_k with v_{k-1}
    (`differenced_noise`); for the paper's recursions it is the position's alone. A tracker's
    ``state_covariance`` takes its place where there is one, the error of v_{k-1} then being
    taken as that of v_k. A process fitted to noisy positions has part of that noise in
    Sigma_u already, so that it counts twice; in simulations with 3 mm to 3 cm of noise this
    widens the standard deviation at step 15 by 1 to 4 %.

    Health gate: unless every check holds, the obstacle is left to ``fallback`` and the
    reason says which failed: enough samples, 4 residual degrees of freedom, regressors of
    condition below 1e6, companion radius at most 1 + 1e-6, predicted speeds at most
    ``max_speed``. Without ``gate`` (the paper has none) only what cannot be computed falls
    back: too few samples, condition above 1e12 (noise-free straight driving: the fit would be
    of rounding errors), not finite, not PSD, or farther than 1000 km. Samples filled in by
    interpolation do not count as samples; they do understate the innovation.

    Parameters
    ----------
    order : number of lags.
    covariance : see above.
    integration : "rectangle" or the paper's "trapezoid". The formula "paper-literal" is
        always the trapezoid's.
    trend : "n" without or "c" with an intercept. The paper does not say; "c" fails on every
        straight run along an axis and pulls velocities to the mean of the window.
    history : newest grid samples used.
    minimum_history : observed samples needed. Stable fits on real robots need 60 to 80.
    max_speed : m/s.
    gate : whether the health gate acts.
    noise_floor : m, added in quadrature to the measurement noise; with 0, and tracks without
        noise, "paper-literal" has a covariance of zero at its first step.
    fallback : predictor for obstacles that fail.

    Raises
    ------
    WideberthError : an unknown option or a number out of range.

    References
    ----------
    H. Luetkepohl, "New Introduction to Multiple Time Series Analysis", 2005, chapters 2, 3.
    """

    order: int = 2
    covariance: Literal["paper-literal", "paper", "exact", "exact+estimation"] = "exact+estimation"
    integration: Integration = "rectangle"
    trend: Literal["n", "c"] = "n"
    history: int = 80
    minimum_history: int = 20
    max_speed: float = 5.0
    gate: bool = True
    noise_floor: float = 0.01
    fallback: Predictor = field(default_factory=Kalman)

    reference: ClassVar[str] = "luetkepohl2005new"

    def __post_init__(self) -> None:
        whole("var.order", self.order)
        whole("var.minimum_history", self.minimum_history, least=self.order + 2)
        whole("var.history", self.history, least=self.minimum_history)
        positive("var.max_speed", self.max_speed)
        positive("var.noise_floor", self.noise_floor, zero=True)
        choices: dict[str, tuple[str, ...]] = {
            "covariance": ("paper-literal", "paper", "exact", "exact+estimation"),
            "integration": ("rectangle", "trapezoid"),
            "trend": ("n", "c"),
        }
        for name, wanted in choices.items():
            if getattr(self, name) not in wanted:
                raise WideberthError(
                    f"var.{name} is {getattr(self, name)!r}; wanted one of {', '.join(wanted)}"
                )

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        noise = measurement_noise(tracks, self.noise_floor)
        past = gather(tracks, length=self.history)
        count, size = len(tracks), tracks.dimension
        mean = np.zeros((count, steps, size))
        covariance = np.zeros((count, steps, size, size))
        joint = np.zeros((count, steps * size, steps * size))
        missing: list[str | None] = [None] * count
        for index in range(count):
            tracker = tracks.state_covariance
            start = self._start(noise[index], None if tracker is None else tracker[index], tracks)
            one = _Past(
                past.origin[index],
                past.positions[index, past.began[index] :],
                int(past.samples[index]),
                int(past.late[index]),
            )
            part = self._one(one, start, tracks.dt, steps)
            if isinstance(part, str):
                missing[index] = f"var: {part}"
                continue
            mean[index], covariance[index] = part[0], part[1]
            joint[index] = 0.0 if part[2] is None else part[2]
        whole_source = partial(np.asarray, joint)
        paper = self.covariance in ("paper", "paper-literal")
        own = Gaussians(mean, covariance, (None,) * count, None if paper else whole_source)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _start(self, noise: Array, tracker: Array | None, tracks: Tracks) -> Array:
        """P_0 of (p_k, v_k, ..., v_{k-p+1})."""
        if tracker is None:
            return differenced_noise(noise, tracks.dt, self.order)
        share = np.zeros((self.order + 1, 2))
        share[0, 0], share[1:, 1] = 1.0, 1.0
        spread = np.kron(share, np.eye(tracks.dimension))
        return np.asarray(spread @ tracker @ spread.T)

    def _one(
        self, past: _Past, start: Array, dt: float, steps: int
    ) -> tuple[Array, Array, Array | None] | str:
        if past.samples < self.minimum_history:
            plural = "" if past.samples == 1 else "s"
            return f"{past.samples} sample{plural}, needs {self.minimum_history}"
        velocities = np.diff(past.positions, axis=0) / dt
        fit = fit_velocities(velocities, self.order, self.trend)
        if isinstance(fit, str):
            return fit
        reason = self._ill(fit)
        if reason is not None:
            return reason
        recent = velocities[: -self.order - 1 : -1]
        ahead = steps + past.late
        with np.errstate(over="ignore", invalid="ignore"):
            means = forecast_velocities(fit.process, recent, ahead)
            moved = displacements(means, recent[0], dt, self.integration)
            part = self._spread(fit, recent, past, moved, start, dt)
        speed = np.linalg.norm(means, axis=1).max(initial=0.0)
        if self.gate and not speed <= self.max_speed:
            return f"predicted speed {speed:.3g} m/s, at most {self.max_speed:g}"
        if not np.abs(moved).max(initial=0.0) < REACH or not part[1].max() < REACH**2:
            return "forecast diverges"
        return part

    def _ill(self, fit: Fit) -> str | None:
        """Why this fit must not be used, or None."""
        process = fit.process
        entries = [process.coefficients, process.innovation, process.intercept]
        if not all(np.isfinite(entry).all() for entry in entries):
            return "fit is not finite"
        lowest, highest = np.linalg.eigvalsh(process.innovation)[[0, -1]]
        if lowest < -1e-9 * max(highest, 0.0) or highest < 0:
            return f"residual covariance has eigenvalue {lowest:.2g}"
        if not fit.condition <= (CONDITION if self.gate else ROUNDING):
            return f"velocities are collinear (condition {fit.condition:.1e})"
        if not self.gate:
            return None
        if fit.freedom < FREEDOM:
            return f"{fit.freedom} residual degrees of freedom, needs {FREEDOM}"
        radius = process.radius()
        if not radius <= 1 + 1e-6:
            return f"companion radius {radius:.4f}, at most 1"
        return None

    def _spread(
        self, fit: Fit, recent: Array, past: _Past, moved: Array, start: Array, dt: float
    ) -> tuple[Array, Array, Array | None]:
        """Mean and covariance of the positions, without the steps already gone by."""
        process, mean, rule = fit.process, past.origin + moved, self.integration
        ahead, size = moved.shape
        if self.covariance in ("paper", "paper-literal"):
            literal = self.covariance == "paper-literal"
            noise = start[:size, :size]
            spread = paper_covariances(process, dt, ahead, noise, rule, literal=literal)
            return mean[past.late :], spread[past.late :], None
        joint = exact_joint(process, dt, ahead, start, rule)
        if self.covariance == "exact+estimation":
            moments = fit.moment_inverse
            joint = joint + estimation_joint(process, dt, recent, ahead, moments, rule)
        kept = joint[past.late * size :, past.late * size :]
        steps = ahead - past.late
        each = np.arange(steps)
        blocks = kept.reshape(steps, size, steps, size)[each, :, each, :]
        return mean[past.late :], blocks, kept
