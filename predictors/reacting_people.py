"""People who react to each other and to the robot's plan; kinds and wishes are inferred."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Adaptive, Predictor
from ..framework.values.arrays import Array, BoolArray, positive, probability, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import ON_GRID, Tracks
from ..people.models import CircularForce, Company, PersonModel, Reciprocal, Straight, Walkers
from ..people.walls import WallField
from .core.assembly import Gaussians, both_reasons, narrowed, refuse_adaptive, with_fallback
from .core.history import measurement_noise
from .core.person_belief import (
    HypothesisSlots,
    PeopleAround,
    PersonBeliefs,
    company_of,
    sight,
    stepped,
)
from .core.social_rollout import RobotCourse, course_of
from .kalman import Kalman

LIGHTEST = 0.02
"""Hypotheses of less weight are not rolled out, beside the heaviest one of each person."""


@dataclass(frozen=True, eq=False)
class Movers:
    """Bodies whose courses are given, at the times 0, step, 2 step and so on.

    Attributes
    ----------
    courses : (M, K + 1, 2), m.
    radius : (M,), m.
    robot : whether the last one is the robot, which the courteous alone see.
    """

    courses: Array
    radius: Array
    robot: bool

    def at(self, row: int, step: float) -> Array:
        """Places, velocities and radii during a step, (M, 5)."""
        place, later = self.courses[:, row], self.courses[:, row + 1]
        return np.concatenate([place, (later - place) / step, self.radius[:, None]], axis=1)


def rolled_out(
    slots: HypothesisSlots,
    beliefs: PersonBeliefs,
    radius: Array,
    movers: Movers,
    walls: WallField,
    step: float,
) -> tuple[Array, Array]:
    """Roll all hypotheses out, (N, S, K + 1, 2), m, and return their weights, (N, S).

    Every step each hypothesis of each person takes the next velocity of its model, seeing the
    others where they are expected: at the weighted mean of their hypotheses. So 200 people with
    S hypotheses cost 200 S walkers, not S^200 crowds. Hypotheses lighter than `LIGHTEST` count
    for nothing and stay at 0.

    Parameters
    ----------
    radius : (N,), m.
    movers : who else is there; K follows from their courses.
    walls : people keep out of them.
    step : s.
    """
    weight = beliefs.weight
    heavy = weight >= np.minimum(LIGHTEST, weight.max(axis=1, keepdims=True, initial=0.0))
    weight = np.where(heavy, weight, 0.0)
    weight = weight / weight.sum(axis=1, keepdims=True)
    count = movers.courses.shape[1] - 1
    state = beliefs.state.copy()
    state[~heavy] = 0.0
    rows = [np.nonzero(heavy & (slots.kind == kind)) for kind in range(len(slots.models))]
    found = np.zeros((*weight.shape, count + 1, 2))
    found[:, :, 0] = state[..., :2]
    for row in range(count):
        mean = np.einsum("ns,nsd->nd", weight, state)
        around = np.concatenate([company_of(mean, radius, None), movers.at(row, step)])
        beside, visible = walls.beside(mean[:, :2]), sight(around, len(mean))
        for model, (owner, slot) in zip(slots.models, rows, strict=True):
            if not len(owner):
                continue
            now = state[owner, slot]
            walkers = Walkers(now[:, :2], now[:, 2:4], now[:, 4:], radius[owner])
            seen = visible[owner]
            if movers.robot:
                seen[:, -1] &= slots.courteous[slot]
            near = beside[owner]
            aside = (now[:, :2] - mean[owner, :2])[:, None] * near[..., 1:]
            near[..., 0] += aside.sum(axis=-1)
            company = Company(around[:, :2], around[:, 2:4], around[:, 4], seen, near)
            state[owner, slot, 2:4] = model.next_velocity(walkers, company, step)
        state[..., :2] += step * state[..., 2:4]
        found[:, :, row + 1] = state[..., :2]
    return found, weight


def on_grid(courses: Array, step: float, times: Array) -> Array:
    """Read courses (..., K + 1, 2) at times (T,), s, on straight lines between their steps."""
    last = courses.shape[-2] - 2
    place = np.clip(times / step, 0.0, last + 1.0)
    below = np.minimum(place.astype(np.int64), last)
    share = (place - below)[:, None]
    return np.asarray((1.0 - share) * courses[..., below, :] + share * courses[..., below + 1, :])


SHORTEST, LONGEST = 0.02, 1.0
"""s, steps of tracks that the models are made for."""
FEWEST = 3
"""Samples from which on something is believed of a person."""
COARSEST = 10.0
"""m, standard deviation of a measurement: a place known no better is none to learn a walk from."""
STRANGE = 0.5
"""Recent share of samples that no model expected, above which the models are not used."""
MOST_WALLS = 32
"""Polygons that count, the nearest ones."""
MEMORY = 40
"""Samples that beliefs are inferred from where none are carried on."""
LONGEST_ROLL_OUT = 400
"""Steps of the models per forecast; longer ones are left to the fallback."""


@dataclass(frozen=True, eq=False)
class PersonBelief:
    """What is believed of one person.

    Attributes
    ----------
    ident : identity.
    kinds : name of the model -> probability.
    courtesy : probability of making way for the robot, of those kinds that avoid at all; the
        prior where the robot has not yet been seen to matter.
    wanted : (2,), m/s, expected wanted velocity.
    spread : (2, 2), its covariance.
    strange : recent share of samples that no model expected.
    """

    ident: str
    kinds: dict[str, float]
    courtesy: float
    wanted: Array
    spread: Array
    strange: float


ACCELERATION_DENSITY = 0.01
"""m^2/s^3, q."""
NOISE_FLOOR = 0.005
"""m, added to the measurement noise."""


def _usual_models() -> tuple[PersonModel, ...]:
    """Return the kinds of people that simulations have; ORCA's are compiled by Numba."""
    return Straight(), CircularForce(), Reciprocal()


@final
@dataclass(frozen=True)
class ReactingPeople(Adaptive):
    """All people walk on together with the robot's last plan, as what they are believed to be.

    Of each person a bank of hypotheses is kept: a kind of model, making way for the robot or not,
    and for models that hide the wish (ORCA) twelve directions of it. Under hypothesis s an
    extended Kalman filter estimates place, velocity and wanted velocity, whose prediction is the
    model's own step among the others, see `wideberth.predictors.core.person_belief`:

        w_s <- w_s (p(z | s) + p_0) / sum of these,      v' = f_s(p, v, u | others, robot)

    The forecast rolls every hypothesis out among the expected motions of the others and the
    robot's plan (``scene.plan``, which courteous hypotheses see), in steps of ``step`` s:

        mu_t = sum_s w_s p_s(t),
        Sigma_t = sum_s w_s (M_t P_s M_t' + (p_s(t) - mu_t)(..)') + q t^3 / 3 I,   M_t = (I 0 tI)

    P_s is the covariance of (p, v, u); q stands for what happens without any reason. How well
    sizes hold is left to `adaptive_conformal` around it.

    What a person does because of the robot is `reaction`, what is believed `beliefs`. `update`
    carries the beliefs on, and notes where the robot is, without which courtesy stays at its
    prior; without `update` they are inferred from the tracks at each call.

    Left to ``fallback``, with the reason: who has fewer than 3 samples or stands exactly still;
    who is measured to no better than 10 m, which counts as not seen; who moves like none of the
    models (recently more than half of the samples unexpected); beyond the nearest ``most`` people
    of the robot, so that work is bounded; all of them where tracks are not in the plane, or their
    steps are not within 0.02 to 1 s. A person who leaps begins anew. All of these are still seen
    by the others, along their own forecast.

    Parameters
    ----------
    models : kinds of people, equally probable at first.
    courtesy : prior probability of making way for the robot.
    step : s, period at which people of the roll-out decide.
    most : people of whom something is believed, where the robot's plan is given.
    fallback : for all others.
    state : what `update` has learnt; None before.

    Raises
    ------
    WideberthError : a number out of range, no model, or a fallback that adapts.
    """

    models: tuple[Straight | CircularForce | Reciprocal | PersonModel, ...] = field(
        default_factory=_usual_models
    )
    courtesy: float = 0.5
    step: float = 0.25
    most: int = 40
    fallback: Predictor = field(default_factory=Kalman)
    state: PersonBeliefs | None = None

    reference: ClassVar[str] = "helbing1995social,vandenberg2011reciprocal"

    def __post_init__(self) -> None:
        positive("reacting_people.step", self.step)
        probability("reacting_people.courtesy", self.courtesy, closed=True)
        whole("reacting_people.most", self.most)
        refuse_adaptive("reacting_people.fallback", self.fallback)
        if not self.models:
            raise WideberthError("reacting_people.models is empty; name at least one model")

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        reason = self._unfit(tracks, steps)
        if reason:
            forecast = self.fallback.predict(tracks, steps, scene)
            said = tuple(both_reasons(reason, deeper) for deeper in forecast.fallback)
            return replace(forecast, fallback=said)
        known = self._known(tracks, scene)
        missing = self._missing(tracks, known)
        served = [row for row, why in enumerate(missing) if why is None]
        mean = np.zeros((len(tracks), steps, 2))
        covariance = np.tile(np.eye(2), (len(tracks), steps, 1, 1))
        if served:
            crowd = self._crowd(tracks, steps, scene, known, served)
            mean[served], covariance[served] = crowd.moments(tracks, steps, self)
        own = Gaussians(mean, covariance, (None,) * len(tracks))
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def reaction(self, tracks: Tracks, steps: int, scene: Scene) -> Array:
        """Return what the robot's plan changes in the expected places, (O, N, 2), m.

        The expected place among all others and the robot, minus that among the others alone. It
        is weighted by courtesy: people who are known not to make way change nothing. Zero for
        those whom the fallback forecasts.
        """
        change = np.zeros((len(tracks), steps, 2))
        if self._unfit(tracks, steps) or scene.plan is None:
            return change
        known = self._known(tracks, scene)
        served = [row for row, why in enumerate(self._missing(tracks, known)) if why is None]
        if served:
            crowd = self._crowd(tracks, steps, scene, known, served)
            alone = crowd.without_robot()
            both = [one.moments(tracks, steps, self)[0] for one in (crowd, alone)]
            change[served] = both[0] - both[1]
        return change

    def beliefs(self, tracks: Tracks, scene: Scene | None = None) -> tuple[PersonBelief, ...]:
        """Return what is believed of each person, where something is, in the tracks' order."""
        if self._unfit(tracks, 1):
            return ()
        known = self._known(tracks, scene)
        return tuple(
            self._belief(known, row)
            for row in range(len(known.ids))
            if known.samples[row] >= FEWEST
        )

    def update(self, tracks: Tracks, scene: Scene | None = None) -> Self:
        """Carry the beliefs on to the newest sample, and note where the robot is then."""
        if self._unfit(tracks, 1):
            return replace(self, state=None)
        course = course_of(scene, tracks.dt, tracks.stamp)
        robot = None
        if course is not None:
            place, velocity = course.at(np.zeros(()))
            robot = np.array([*place, *velocity, course.radius])
        return replace(self, state=replace(self._known(tracks, scene), robot=robot))

    @cached_property
    def _slots(self) -> HypothesisSlots:
        return HypothesisSlots(self.models, self.courtesy)

    def _unfit(self, tracks: Tracks, steps: int) -> str:
        """Why the models cannot forecast these tracks; empty where they can."""
        if tracks.dimension != 2:
            return f"reacting_people: {tracks.dimension} coordinates, made for 2"
        if not SHORTEST <= tracks.dt <= LONGEST:
            made = f"made for {SHORTEST:g} to {LONGEST:g} s"
            return f"reacting_people: steps of {tracks.dt:g} s, {made}"
        if steps * tracks.dt > LONGEST_ROLL_OUT * self.step:
            return (
                f"reacting_people: {steps * tracks.dt:g} s ahead, at most "
                f"{LONGEST_ROLL_OUT * self.step:g} s"
            )
        return ""

    def _known(self, tracks: Tracks, scene: Scene | None) -> PersonBeliefs:
        """Beliefs of the nearest people at the newest sample."""
        rows = _nearest(tracks, course_of(scene, tracks.dt, tracks.stamp), self.most)
        some = tracks if len(rows) == len(tracks) else tracks.select(rows)
        noise, coarse = measurement_noise(some, NOISE_FLOOR), _coarse(some)
        walls = _walls(scene, some)
        before, times = self._since(some)
        slots = self._slots
        for time in times:
            measured = np.where(coarse[:, None], np.nan, _places(some, time))
            beside = walls.beside(before.mean[:, :2])
            around = PeopleAround(some.radius, beside)
            before = stepped(slots, before, measured, noise, around, time - before.stamp)
        return before

    def _since(self, tracks: Tracks) -> tuple[PersonBeliefs, Array]:
        """Return beliefs to go on from, and the times of the samples since, s."""
        state, dt, stamp = self.state, tracks.dt, tracks.stamp
        rows = tracks.positions.shape[1]
        slack = max(1e-6 * dt, 4.0 * float(np.spacing(abs(stamp))))
        if state is not None and state.weight.shape[1] == len(self._slots.group):
            gone = stamp - state.stamp
            if abs(state.dt - dt) <= 1e-9 and -slack <= gone <= (rows - 1) * dt:
                count = max(round(gone / dt), 1) if gone > slack else 0
                times = state.stamp + gone * np.arange(1.0, count + 1) / max(count, 1)
                return state.of(self._slots, tracks.ids), times
        first = min(rows, MEMORY)
        times = stamp - dt * np.arange(first - 1.0, -1.0, -1.0)
        return PersonBeliefs.none(self._slots, tracks.ids, stamp - first * dt, dt), times

    def _missing(self, tracks: Tracks, known: PersonBeliefs) -> list[str | None]:
        """Say of each person why the models do not forecast him, or None."""
        place = {ident: row for row, ident in enumerate(known.ids)}
        found: list[str | None] = []
        for ident, coarse in zip(tracks.ids, _coarse(tracks), strict=True):
            row = place.get(ident)
            why = None
            if coarse:
                why = f"measured to no better than {COARSEST:g} m"
            elif row is None:
                why = f"not among the nearest {self.most}"
            elif known.samples[row] < FEWEST:
                why = f"{int(known.samples[row])} samples on the way, needs {FEWEST}"
            elif known.strange[row] > STRANGE:
                names = ", ".join(model.name for model in self.models)
                why = f"moves like none of {names}"
            found.append(None if why is None else f"reacting_people: {why}")
        return found

    def _crowd(
        self,
        tracks: Tracks,
        steps: int,
        scene: Scene | None,
        known: PersonBeliefs,
        served: list[int],
    ) -> "_Crowd":
        """Gather all people for a roll-out; who is not served follows his own forecast."""
        count = max(ceil(steps * tracks.dt / self.step - 1e-9), 1)
        times = self.step * np.arange(count + 1.0)
        seen = _seen(tracks).max(axis=1, initial=False)
        rest = [row for row in range(len(tracks)) if row not in set(served) and seen[row]]
        courses = np.zeros((0, count + 1, 2))
        if rest:
            ahead = max(steps, 2)
            some = self.fallback.predict(tracks.select(rest), ahead, narrowed(scene, rest))
            places = np.einsum("om,omnd->ond", some.weight, some.mean)
            begun = np.concatenate([2.0 * places[:, :1] - places[:, 1:2], places], axis=1)
            courses = on_grid(begun, tracks.dt, times)
        radius, course = tracks.radius[rest], course_of(scene, tracks.dt, tracks.stamp)
        if course is not None:
            courses = np.concatenate([courses, course.at(times)[0][None]])
            radius = np.append(radius, course.radius)
        ids = [tracks.ids[row] for row in served]
        return _Crowd(
            known.of(self._slots, ids),
            tracks.radius[served],
            Movers(courses, radius, course is not None),
            _walls(scene, tracks.select(served)),
        )

    def _belief(self, known: PersonBeliefs, row: int) -> PersonBelief:
        slots = self._slots
        groups = slots.in_groups(known.weight[row : row + 1])[0]
        kinds = dict.fromkeys((model.name for model in self.models), 0.0)
        avoiding = courteous = 0.0
        for (kind, courtesy, _), share in zip(slots.groups, groups.tolist(), strict=True):
            kinds[self.models[kind].name] += share
            if self.models[kind].avoids:
                avoiding += share
                courteous += share * courtesy
        weight, wanted = known.weight[row], known.state[row, :, 4:]
        mean = weight @ wanted
        apart = wanted - mean
        spread = np.einsum("s,sij->ij", weight, known.covariance[row, :, 4:, 4:])
        spread += np.einsum("s,si,sj->ij", weight, apart, apart)
        likely = courteous / avoiding if avoiding > 0.0 else self.courtesy
        return PersonBelief(known.ids[row], kinds, likely, mean, spread, float(known.strange[row]))


@dataclass(frozen=True, eq=False)
class _Crowd:
    """All people who take part in a roll-out."""

    beliefs: PersonBeliefs
    radius: Array
    movers: Movers
    walls: WallField

    def without_robot(self) -> "_Crowd":
        """Return the same without the robot."""
        movers = Movers(self.movers.courses[:-1], self.movers.radius[:-1], robot=False)
        return replace(self, movers=movers)

    def moments(self, tracks: Tracks, steps: int, settings: ReactingPeople) -> tuple[Array, Array]:
        """Mean, (N, T, 2), and covariance, (N, T, 2, 2), of the forecast."""
        beliefs, step, slots = self.beliefs, settings.step, settings._slots
        found, weight = rolled_out(slots, beliefs, self.radius, self.movers, self.walls, step)
        times = tracks.dt * np.arange(1.0, steps + 1)
        places = on_grid(found, step, times)
        mean = np.einsum("ns,nstd->ntd", weight, places)
        apart = places - mean[:, None]
        known = np.einsum("ns,nsij->nij", weight, beliefs.covariance)
        place, wish, both = known[:, :2, :2], known[:, 4:, 4:], known[:, :2, 4:]
        t = times[:, None, None]
        covariance = place[:, None] + t**2 * wish[:, None]
        covariance += t * (both + np.swapaxes(both, 1, 2))[:, None]
        covariance += np.einsum("ns,nsti,nstj->ntij", weight, apart, apart)
        covariance += ACCELERATION_DENSITY * t**3 / 3.0 * np.eye(2)
        return mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def _nearest(tracks: Tracks, course: RobotCourse | None, most: int) -> list[int]:
    """Rows of the people nearest to the robot now; all of them without a robot."""
    if course is None or len(tracks) <= most:
        return list(range(len(tracks)))
    seen = _seen(tracks)
    newest = tracks.positions.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1)
    here = tracks.positions[np.arange(len(tracks)), newest]
    away = np.linalg.norm(here - course.at(np.zeros(()))[0], axis=1)
    away = np.where(np.isfinite(away), away, np.inf)
    order = sorted(range(len(tracks)), key=lambda row: (away[row], tracks.ids[row]))
    return sorted(order[:most])


def _seen(tracks: Tracks) -> BoolArray:
    """Whether each sample was observed, (O, T)."""
    return np.asarray(np.isfinite(tracks.positions).all(axis=2), dtype=np.bool_)


def _coarse(tracks: Tracks) -> BoolArray:
    """Whether the places of each are too uncertain to be used, (O,)."""
    return np.asarray(tracks.noise.trace(axis1=1, axis2=2) > COARSEST**2, dtype=np.bool_)


def _walls(scene: Scene | None, tracks: Tracks) -> WallField:
    """Return the polygons nearest to anybody, at most `MOST_WALLS`."""
    if scene is None or not scene.polygons:
        return WallField()
    places = tracks.positions.reshape(-1, 2)
    places = places[np.isfinite(places).all(axis=1)]
    return WallField(scene.polygons).nearest(places, MOST_WALLS)


def _places(tracks: Tracks, time: float) -> Array:
    """Where each of them was at a time within the tracks, (N, 2), m; NaN where not seen."""
    rows = tracks.positions.shape[1]
    place = min(max(rows - 1 - (tracks.stamp - time) / tracks.dt, 0.0), rows - 1.0)
    nearest = round(place)
    if abs(place - nearest) < ON_GRID:
        return np.asarray(tracks.positions[:, nearest])
    below = int(place)
    share = place - below
    before, after = tracks.positions[:, below], tracks.positions[:, below + 1]
    return np.asarray((1.0 - share) * before + share * after)
