"""The solver ``batch``: many instances of a problem at once, in JAX, on the device it finds."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.solver import ManySolver, Solution, on_time, refuse_misfits, refuse_unequal
from ...framework.values.arrays import Array, BoolArray, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Status
from ..interior_point import ITERATIONS, START_DISTANCE, TOLERANCE
from .method import ExitCode, MethodSettings, advance, report, start
from .program import packed, program

_STATUS = {
    ExitCode.RUNNING: Status.LIMIT,
    ExitCode.SOLVED: Status.SOLVED,
    ExitCode.LIMIT: Status.LIMIT,
    ExitCode.INFEASIBLE: Status.INFEASIBLE,
    ExitCode.FAILED: Status.FAILED,
}


LEAST = 8
"""Smallest number of instances that is compiled for; a single one takes as long as these."""
TURNS = 4
"""Iterations between two looks at which have ended."""
SHARE = 0.25
"""Of the lanes; once so many have ended, others take their place."""
WIDTHS = {"cpu": 64}
"""Instances computed at once, by device. A processor's caches hold no more."""
WIDE = 4096
"""The same for all other devices."""


@final
@dataclass(frozen=True, eq=False)
class BatchSolution:
    """What `solve_batch` returns; the first axis is the instance, B.

    Attributes
    ----------
    states, inputs : (B, N + 1, n) and (B, N, m), the last iterates, whatever the status.
    auxiliaries : (B, N, K, A) of the slots of each kind.
    level : (B,), shared levels; nan where none is shared.
    slack : (B, N).
    status : how each ended.
    cost : (B,), objective.
    violation : (B,), largest violation of dynamics, limits and regions, slack not counted.
    iterations : (B,).
    seconds : wall time of all together.
    """

    states: Array
    inputs: Array
    auxiliaries: tuple[Array, ...]
    level: Array
    slack: Array
    status: tuple[Status, ...]
    cost: Array
    violation: Array
    iterations: Array
    seconds: float

    def __len__(self) -> int:
        """Count the instances."""
        return len(self.status)

    def solutions(self) -> list[Solution]:
        """Return the solutions one by one; each has the wall time of all together."""
        numbers = zip(self.status, self.cost.tolist(), self.iterations.tolist(), strict=True)
        return [
            Solution(
                self.point(i),
                status,
                f"{status} after {count} iterations",
                cost,
                count,
                self.seconds,
            )
            for i, (status, cost, count) in enumerate(numbers)
        ]

    def point(self, index: int) -> Guess:
        """Return one solution as a starting point for other solves."""
        return Guess(
            self.states[index],
            self.inputs[index],
            tuple(own[index] for own in self.auxiliaries),
            float(self.level[index]),
            self.slack[index],
        )


@final
@dataclass(frozen=True)
class Batch(ManySolver):
    """Primal-dual interior point in JAX that solves many instances of one problem at once.

    ``width`` of them advance in step on JAX's default device, in double precision whether or not
    the caller has set JAX to it; where one has ended, another begins. Each ends as it would
    alone, but for rounding, and its status says how. The first call for a problem and a width
    compiles for seconds: for studies, not for the robot. The method and its constants are those of
    `Riccati`.

    Parameters
    ----------
    iterations : limit.
    tolerance : of the optimality conditions.
    width : instances computed at once, rounded up to a power of two; None for what suits the
        device. Fewer instances are computed at the power of two that holds them.
    """

    iterations: int = ITERATIONS
    tolerance: float = TOLERANCE
    width: int | None = None

    def __post_init__(self) -> None:
        whole("batch.iterations", self.iterations)
        positive("batch.tolerance", self.tolerance)
        if self.width is not None:
            whole("batch.width", self.width)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess, all at once; a deadline stops nothing, but is reported."""
        begin = perf_counter()
        found = self.solve_many(problem, [parameters] * len(guesses), guesses)
        return [on_time(one, perf_counter() - begin, deadline) for one in found]

    def solve_many(
        self,
        problem: Problem,
        parameters: Sequence[Parameters],
        guesses: Sequence[Guess],
        workers: int | None = None,
    ) -> list[Solution]:
        """Solve many instances at once; JAX takes the cores it likes, not ``workers``."""
        return self.arrays(problem, parameters, guesses).solutions() if len(guesses) else []

    def arrays(
        self, problem: Problem, parameters: Sequence[Parameters], guesses: Sequence[Guess]
    ) -> BatchSolution:
        """Solve many instances at once, one at least, into arrays whose first axis is theirs.

        Raises
        ------
        WideberthError : as many parameters as guesses are needed, arrays do not fit the problem,
            or its expressions are too long to be compiled.
        """
        begin = perf_counter()
        refuse_unequal(parameters, guesses)
        if not parameters:
            raise WideberthError("got no instance to solve; wanted one at least")
        for one, guess in zip(parameters, guesses, strict=True):
            refuse_misfits(problem, one, [guess])
        import jax

        with jax.enable_x64(True):
            width = self.width or WIDTHS.get(jax.default_backend(), WIDE)
            size = min(_power(len(parameters)), _power(width))
            own = MethodSettings(self.iterations, self.tolerance)
            found = _compiled(problem, own)(parameters, guesses, size)
        status = tuple(_STATUS[ExitCode(code)] for code in found.pop("code"))
        lifted = tuple(found.pop(f"auxiliaries{k}") for k in range(len(problem.slots)))
        seconds = perf_counter() - begin
        return BatchSolution(**found, auxiliaries=lifted, status=status, seconds=seconds)


def solve_batch(
    problem: Problem,
    parameters: Sequence[Parameters],
    guesses: Sequence[Guess],
    *,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
    width: int | None = None,
) -> BatchSolution:
    """Solve many instances of one problem, see `Batch.arrays`."""
    return Batch(iterations, tolerance, width).arrays(problem, parameters, guesses)


class _Method:
    """The iteration compiled for a problem, once per number of instances.

    Parameters
    ----------
    problem, settings : what is compiled.
    """

    def __init__(self, problem: Problem, settings: MethodSettings) -> None:
        import jax

        made = program(problem)
        self._program, self._settings = made, settings
        compiled = partial(jax.jit, compiler_options=_options())
        self._start = compiled(partial(start, made, own=settings))
        self._advance = compiled(partial(advance, made, own=settings))
        self._report = compiled(partial(report, made))
        self._merge = compiled(_merged)

    def __call__(
        self, parameters: Sequence[Parameters], guesses: Sequence[Guess], size: int
    ) -> dict[str, Array]:
        """Solve instances on ``size`` lanes: fields of the solution and ``code``."""
        count = len(guesses)
        queue = packed(self._program, parameters, guesses, START_DISTANCE)
        lanes = self._begin(queue, np.arange(size) % count, np.arange(size) < count)
        owner, waiting = np.minimum(np.arange(size), count), min(size, count)
        found: dict[str, Array] = {}
        while True:
            given, at = lanes
            at = self._advance(given, at, TURNS)
            lanes, busy = (given, at), owner < count
            ended = busy & (np.asarray(at.code) != ExitCode.RUNNING)
            wanted = SHARE * size if waiting < count else busy.sum()
            if ended.sum() < wanted:
                continue
            _write(found, owner, ended, self._report(given, at), count)
            owner[ended] = count
            if waiting == count and ended.sum() == busy.sum():
                return found
            fresh = np.flatnonzero(ended)[: count - waiting]
            owner[fresh] = waiting + np.arange(len(fresh))
            waiting += len(fresh)
            chosen = np.isin(np.arange(size), fresh)
            lanes = self._merge(chosen, self._begin(queue, owner % count, chosen), lanes)

    def _begin(self, queue: Any, owner: Any, fresh: Any) -> Any:
        """Take instances out of the queue and start those that are fresh."""
        import jax

        given, guess = jax.tree.map(lambda values: values[..., owner], queue)
        return given, self._start(given, guess, ~fresh)


def _merged(chosen: Any, new: Any, old: Any) -> Any:
    """Take the chosen lanes from the one, the others from the other."""
    import jax
    import jax.numpy as jnp

    return jax.tree.map(lambda one, other: jnp.where(chosen, one, other), new, old)


def _write(
    found: dict[str, Array], owner: NDArray[np.intp], ended: BoolArray, values: Any, count: int
) -> None:
    """Write what the lanes that ended hold to the instances that own them."""
    for name, value in values.items():
        rows = np.asarray(value)
        if name not in found:
            found[name] = np.empty((count, *rows.shape[1:]), dtype=rows.dtype)
        found[name][owner[ended]] = rows[ended]


def _power(count: int) -> int:
    """Return the power of two that holds ``count``, `LEAST` at least."""
    return max(LEAST, 1 << max(count - 1, 0).bit_length())


@cache
def _options() -> dict[str, bool | int]:
    """Return settings of XLA for processors: half the time to compile, and faster code.

    They are no promise of XLA, so that a trial says whether they are there.
    """
    import jax

    options: dict[str, bool | int] = {
        "xla_cpu_use_fusion_emitters": False,
        "xla_backend_optimization_level": 1,
    }
    if jax.default_backend() != "cpu":
        return {}
    try:
        jax.jit(lambda x: x + 1, compiler_options=options)(0)
    except Exception:
        return {}
    return options


_CACHE: OrderedDict[tuple[str, MethodSettings], _Method] = OrderedDict()
_CACHE_SIZE = 16


def _compiled(problem: Problem, settings: MethodSettings) -> _Method:
    """Take a method from this process's cache, or make it."""
    key = problem.key, settings
    if key not in _CACHE:
        _CACHE[key] = _Method(problem, settings)
        if len(_CACHE) > _CACHE_SIZE:
            _CACHE.popitem(last=False)
    _CACHE.move_to_end(key)
    return _CACHE[key]
