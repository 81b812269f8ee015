"""The paper's predictor: a vector autoregression on each obstacle's velocities."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, BoolArray, checked_choice, positive, whole
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import Gaussians, placed, refuse_adaptive, with_fallback
from .core.history import Histories, gather
from .core.least_squares import Fits, fit_velocities, fit_with_statsmodels
from .core.propagation import after
from .core.small_matrices import lower_root
from .core.velocity_forecast import (
    past_velocities,
    process_gaussians,
    process_means,
    start_covariance,
)
from .core.velocity_process import SETTLED, Integration, VelocityProcess, velocity_path
from .kalman import Kalman


def velocity_covariances(process: VelocityProcess, steps: int) -> Array:
    """Sigma_v,h = sum over i < h of Phi_i Sigma_u Phi_i', (O, N, D, D), (m/s)^2."""
    companion, size = process.companion(), process.innovation.shape[-1]
    response = np.broadcast_to(np.eye(companion.shape[1], size), (*companion.shape[:2], size))
    # Products of roots: an explosive process would cost the sum its symmetry in rounding.
    root = np.moveaxis(lower_root(np.moveaxis(process.innovation, 0, -1)), -1, 0)
    total = np.zeros_like(root)
    covariances = np.zeros((len(total), steps, size, size))
    for h in range(steps):
        newest = response[:, :size] @ root
        total = total + np.einsum("oic,ojc->oij", newest, newest)
        covariances[:, h] = total
        response = companion @ response
    return covariances


def paper_covariances(
    process: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration = "trapezoid",
    *,
    literal: bool = False,
) -> Array:
    """Covariances as the paper sums them, (O, N, D, D), m^2; too small, see below.

    The paper: Sigma_{k+i} = Sigma_{k+i-1} + dT^2/4 (Sigma_{v,k} + Sigma_{v,k+i-1}),
    "neglecting the covariances between the summands". ``literal`` does just that, with
    Sigma_{v,k} = 0, as the velocity at k is known. Otherwise the index is corrected so that it
    matches the paper's mean: Sigma_{v,k} becomes Sigma_{v,k+i}. With ``integration``
    "rectangle" (and not literal) the same neglect is made on the rectangle rule,
    Sigma_{k+i} = Sigma_{k+i-1} + dT^2 Sigma_{v,k+i}.

    Difference: a nominal 95 % ellipse covers 13 % at step 15 where velocities persist (6 %
    literally), because errors of successive velocities are nearly equal, not independent.

    Parameters
    ----------
    process, dt, steps, integration : as in `process_covariances`.
    start : (O, D, D), m^2, Sigma_k; the paper does not state it.
    literal : the printed formula, which is always the trapezoid's.
    """
    ahead = velocity_covariances(process, steps)
    before = np.concatenate([np.zeros_like(ahead[:, :1]), ahead[:, :-1]], axis=1)
    if literal:
        growth = 0.25 * dt**2 * before
    elif integration == "trapezoid":
        growth = 0.25 * dt**2 * (ahead + before)
    else:
        growth = dt**2 * ahead
    return np.asarray(start[:, None] + np.cumsum(growth, axis=1))


Covariance: TypeAlias = Literal["paper-literal", "paper", "exact", "exact+estimation"]

CONDITION = 1e6
"""Largest condition number of the regressors Z that the gate lets pass."""
ROUNDING = 1e12
"""Largest condition number without the gate: above it least squares fits rounding errors."""
FREEDOM = 4
"""Fewest residual degrees of freedom that the gate lets pass."""
REACH = 1e6
"""m; a forecast that leaves this radius has overflowed in all but name, gate or no gate."""
HISTORY = 80
"""Newest grid samples used."""


@final
@dataclass(frozen=True)
class VectorAutoregression(Predictor):
    """VAR(2) on world-frame velocities, fitted to each obstacle's own history.

        v_{h} = A_1 v_{h-1} + A_2 v_{h-2} + u_h,   u_h ~ N(0, Sigma_u)

    with v_k = (p_k - p_{k-1}) / dT, fitted by least squares at every call, without an intercept:
    the paper does not say, and one fails on every straight run along an axis and pulls
    velocities to the mean of the window. Positions follow
    by summing velocities up, their covariance by ``covariance``:

    - "paper-literal", "paper": the paper's recursion as printed, and with its index mended
      (see `paper_covariances`). Both neglect covariances between successive velocities: a
      nominal 95 % ellipse covers 13 % at step 15 where velocities persist, and 51 % on
      average on recorded people.
    - "exact": the covariance that the fitted process has (95 % where the process is true).
    - "exact+estimation" (default): and that of the fitted coefficients (`Estimation`).

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
    of rounding errors), not finite, or farther than 1000 km. Samples filled in by
    interpolation do not count as samples; they do understate the innovation.

    Parameters
    ----------
    order : number of lags.
    covariance : see above.
    integration : "rectangle" or the paper's "trapezoid". The formula "paper-literal" is
        always the trapezoid's.
    minimum_history : observed samples needed. Stable fits on real robots need 60 to 80.
    max_speed : m/s.
    gate : whether the health gate acts.
    noise_floor : m, added in quadrature to the measurement noise; with 0, and tracks without
        noise, "paper-literal" has a covariance of zero at its first step.
    fallback : predictor for obstacles that fail.
    backend : what fits, equal to rounding: "batched", all obstacles at once, or "statsmodels",
        one after the other, as in the paper. The library is imported when the predictor is built.

    Raises
    ------
    WideberthError : an unknown option or a number out of range.

    References
    ----------
    H. Luetkepohl, "New Introduction to Multiple Time Series Analysis", 2005, chapters 2, 3.
    """

    order: int = 2
    covariance: Covariance = "exact+estimation"
    integration: Integration = "rectangle"
    minimum_history: int = 20
    max_speed: float = 5.0
    gate: bool = True
    noise_floor: float = 0.01
    fallback: Predictor = field(default_factory=Kalman)
    backend: Literal["batched", "statsmodels"] = "batched"

    reference: ClassVar[str] = "luetkepohl2005new"

    def __post_init__(self) -> None:
        refuse_adaptive("var.fallback", self.fallback)
        whole("var.order", self.order)
        whole("var.minimum_history", self.minimum_history, least=self.order + 2)
        positive("var.max_speed", self.max_speed)
        positive("var.noise_floor", self.noise_floor, zero=True)
        checked_choice("var.covariance", self.covariance, Covariance)
        checked_choice("var.integration", self.integration, Integration)
        checked_choice("var.backend", self.backend, Literal["batched", "statsmodels"])
        self._import()

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        self._import()

    def _import(self) -> None:
        """Import what a fit needs: it takes seconds, which no decision should."""
        if self.backend == "statsmodels":
            import statsmodels.tsa.vector_ar.var_model  # noqa: F401

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=HISTORY)
        velocities, recent = past_velocities(past, tracks.dt, self.order)
        fits = self._fit(velocities, past)
        missing = self._ill(fits, past)
        sound = np.flatnonzero([reason is None for reason in missing])
        past, process, root = past.select(sound), fits.process.select(sound), fits.root[sound]
        start = start_covariance(tracks, self.noise_floor, self.order)[sound]
        # Without the gate an explosive fit may overflow; `_judge` says so.
        with np.errstate(all="ignore"):
            path = velocity_path(process, recent[sound], steps + int(past.late.max(initial=0)))
            own = self._spread(process, root, past, path, start, tracks.dt, steps)
            for o, reason in zip(sound, self._judge(own, past, path), strict=True):
                missing[o] = reason
        named = [None if reason is None else f"var: {reason}" for reason in missing]
        own = placed(own, sound, len(tracks))
        return with_fallback(own, named, self.fallback, tracks, scene)

    def _fit(self, velocities: Array, past: Histories) -> Fits:
        if self.backend == "statsmodels":
            return fit_with_statsmodels(velocities, past.began, self.order)
        return fit_velocities(velocities, past.began, self.order, self._limit)

    @property
    def _limit(self) -> float:
        return CONDITION if self.gate else ROUNDING

    def _ill(self, fits: Fits, past: Histories) -> list[str | None]:
        """Why each fit must not be used, or None."""
        process, missing = fits.process, list(fits.failed)
        for o in np.flatnonzero(past.samples < self.minimum_history):
            plural = "" if past.samples[o] == 1 else "s"
            missing[o] = f"{past.samples[o]} sample{plural}, needs {self.minimum_history}"
        collinear = ~(fits.condition <= self._limit)
        text = "velocities are collinear (condition {:.1e})"
        _mark(missing, collinear, text, fits.condition)
        infinite = ~process.finite()
        _mark(missing, infinite, "fit is not finite", fits.condition)
        if not self.gate:
            return missing
        few = fits.freedom < FREEDOM
        _mark(missing, few, f"{{}} residual degrees of freedom, needs {FREEDOM}", fits.freedom)
        rest = np.flatnonzero([reason is None for reason in missing])
        radius = np.zeros(len(missing))
        radius[rest] = process.select(rest).radius(floor=SETTLED)
        _mark(missing, radius > 1 + 1e-6, "companion radius {:.4f}, at most 1", radius)
        return missing

    def _spread(
        self,
        process: VelocityProcess,
        root: Array,
        past: Histories,
        path: Array,
        start: Array,
        dt: float,
        steps: int,
    ) -> Gaussians:
        """Mean and covariance of the positions, without the steps already gone by."""
        rule = self.integration
        if self.covariance in ("exact", "exact+estimation"):
            known = None if self.covariance == "exact" else root
            return process_gaussians(process, past, path, start, dt, steps, rule, known)
        size, ahead = past.origin.shape[1], path.shape[1] - self.order
        literal, noise = self.covariance == "paper-literal", start[:, :size, :size]
        spread = paper_covariances(process, dt, ahead, noise, rule, literal=literal)
        mean = process_means(past, path, self.order, dt, steps, rule)
        return Gaussians(mean, after(spread, steps, past.late), (None,) * len(mean))

    def _judge(self, own: Gaussians, past: Histories, path: Array) -> list[str | None]:
        """Why each forecast must not be used, now that it is there, or None."""
        missing: list[str | None] = [None] * len(own.mean)
        ahead = path[:, self.order :]
        within = np.arange(ahead.shape[1]) < (own.steps + past.late)[:, None]
        squares = np.where(within, np.einsum("ohi,ohi->oh", ahead, ahead), 0.0)
        speed = np.sqrt(squares.max(axis=1, initial=0.0))
        if self.gate:
            text = f"predicted speed {{:.3g}} m/s, at most {self.max_speed:g}"
            _mark(missing, ~(speed <= self.max_speed), text, speed)
        moved = _largest(np.abs(own.mean - past.origin[:, None]))
        widest = _largest(own.covariance)
        diverges = ~(moved < REACH) | ~(widest < REACH**2)
        _mark(missing, diverges, "forecast diverges", widest)
        return missing


def _mark(missing: list[str | None], bad: BoolArray, text: str, values: ArrayLike) -> None:
    """Write down a reason, with the value in it, where there is none yet."""
    each = np.asarray(values).tolist()  # these are printed faster than NumPy's
    for o in np.flatnonzero(bad).tolist():
        if missing[o] is None:
            missing[o] = text.format(each[o])


def _largest(values: Array) -> Array:
    """Largest entry of each obstacle, (O,)."""
    # One long axis: over several short ones the same takes ten times as long.
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    return np.asarray(flat.max(axis=1, initial=0.0))
