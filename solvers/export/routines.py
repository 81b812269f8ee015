"""The functions of a problem that are written as C, with their first and second derivatives."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...framework.mpc.ocp.problem import Problem
from ...framework.mpc.ocp.transcription import Transcription
from ...framework.numerics.symbolic import ca
from ...framework.values.errors import WideberthError


@dataclass(frozen=True, eq=False)
class Routine:
    """One C function: vectors in, one vector or matrix out.

    Attributes
    ----------
    name : in C, after the prefix.
    function : CasADi, on SX, with one result.
    arguments : names of its arguments.
    result : name of its result.
    text : what it is, in a sentence.
    slots : name of the kind of slots that it is about, or empty.
    """

    name: str
    function: Any
    arguments: tuple[str, ...]
    result: str
    text: str
    slots: str = ""

    @property
    def size(self) -> int:
        """Count the numbers of the result; of a sparse one those that are kept."""
        return int(self.function.nnz_out(0))


STAGE = {
    "dynamics": "x_{i+1} = f(x_i, u_i), i = 0..N-1",
    "input_cost": "cost of step i = 0..N-1, with the head of stage i + 1",
    "input_constraints": "limits of the robot, each >= 0, at i = 0..N-1",
    "state_cost": "cost of stage i = 1..N",
    "state_constraints": "limits of the robot, each >= 0, at i = 1..N",
    "terminal_constraints": "each >= 0, at i = N alone",
    "level_cost": "cost of the shared level, once",
}
"""The functions of one stage that belong to no slot, and what they are."""
SLOT = "one {} slot at i = 1..N: its inequalities (>= 0), then equalities (== 0)"
"""What the function of a kind of slots is, which bears the kind's name."""


def stage_routines(problem: Problem) -> list[Routine]:
    """Return the functions of one stage and their derivatives, in calling order.

    Those of a kind of slots are left out where there are no slots.

    Raises
    ------
    WideberthError : a function that cannot be expanded into scalar operations.
    """
    step, slot = ("state", "input"), ("state", "auxiliary", "level", "numbers")
    given = {
        "dynamics": (problem.dynamics, step, 2),
        "input_cost": (problem.input_cost, (*step, "head"), 2),
        "input_constraints": (problem.input_constraints, step, 2),
        "state_cost": (problem.state_cost, ("state", "head"), 1),
        "state_constraints": (problem.state_constraints, ("state",), 1),
        "terminal_constraints": (problem.terminal_constraints, ("state",), 1),
        **{one.name: (one.constraint, slot, 3) for one in problem.slots if one.count},
        "level_cost": (problem.level_cost, ("level", "target"), 1),
    }
    kinds = {one.name for one in problem.slots}
    return [
        replace(routine, slots=name if name in kinds else "")
        for name, (function, arguments, by) in given.items()
        for routine in _with_derivatives(name, function, arguments, by)
    ]


def _with_derivatives(
    name: str, function: Any, arguments: Sequence[str], by: int
) -> Iterator[Routine]:
    """Yield a function, its Jacobian and its Hessian by the first ``by`` arguments."""
    inside = expanded(name, function)
    symbols = [ca.SX.sym(each, inside.size1_in(i)) for i, each in enumerate(arguments)]
    rows = ca.densify(ca.vertcat(*inside.call(symbols)))
    variables = ca.vertcat(*symbols[:by])
    weights = ca.SX.sym("weights", rows.numel())
    slope = ca.densify(ca.jacobian(rows, variables))
    bend = ca.densify(ca.hessian(ca.dot(weights, rows), variables)[0])
    result = "next" if name == "dynamics" else "cost" if name.endswith("_cost") else "rows"
    shape, size = f"{rows.numel()} x {variables.numel()}", variables.numel()
    named = ", ".join(arguments[:by])
    yield _routine(name, symbols, rows, arguments, result, STAGE.get(name, SLOT.format(name)))
    yield _routine(
        f"{name}_jacobian",
        symbols,
        slope,
        arguments,
        "jacobian",
        f"of the rows by ({named}), {shape}",
    )
    yield _routine(
        f"{name}_hessian",
        [*symbols, weights],
        bend,
        (*arguments, "weights"),
        "hessian",
        f"of weights' rows by ({named}), {size} x {size}, both triangles",
    )


def _routine(
    name: str, symbols: Sequence[Any], out: Any, arguments: Sequence[str], result: str, text: str
) -> Routine:
    function = ca.Function(f"wideberth_casadi_{name}", list(symbols), [out])
    return Routine(name, function, tuple(arguments), result, text)


def expanded(name: str, function: Any) -> Any:
    """Return a function as scalar operations, of which C can be made.

    Raises
    ------
    WideberthError : it holds something else, a call of an external library, say.
    """
    try:
        return function.expand()
    except (RuntimeError, NotImplementedError) as error:
        reason = str(error).strip().splitlines()[-1]
        raise WideberthError(
            f"the problem's {name} cannot be expanded into scalar operations ({reason}); write "
            "the plug-in with CasADi or NumPy functions of its symbolic arguments alone"
        ) from None


def flat_routines(form: Transcription) -> list[Routine]:
    """Return cost, constraints and their derivatives of the whole problem as one NLP.

    Gradient and constraints are dense vectors; of the Jacobian and the upper triangle of the
    Hessian the nonzeros are given, column by column.
    """
    program = ca.Function("nlp", form.nlp(), ["x", "p"], ["f", "g"])
    plain = ("variables", "parameters")
    weighted = (*plain, "weight", "multipliers")
    kinds = {
        "nlp_cost": (["f"], plain, "cost", "f, all costs"),
        "nlp_constraints": (["g"], plain, "rows", "g, all rows"),
        "nlp_gradient": (["grad:f:x"], plain, "gradient", "of the cost by the variables"),
        "nlp_jacobian": (["jac:g:x"], plain, "values", "nonzeros of the Jacobian of the rows"),
        "nlp_hessian": (
            ["triu:hess:gamma:x:x"],
            weighted,
            "values",
            "nonzeros of the Hessian of weight * f + multipliers' g, upper triangle",
        ),
    }
    found = []
    for name, (out, arguments, result, text) in kinds.items():
        given = ["x", "p"] if arguments is plain else ["x", "p", "lam:f", "lam:g"]
        made = program.factory(f"wideberth_casadi_{name}", given, out, {"gamma": ["f", "g"]})
        dense = name in ("nlp_cost", "nlp_constraints", "nlp_gradient")
        found.append(Routine(name, _dense(made) if dense else made, arguments, result, text))
    return found


def _dense(function: Any) -> Any:
    symbols = [ca.SX.sym(f"a{i}", function.sparsity_in(i)) for i in range(function.n_in())]
    return ca.Function(function.name(), symbols, [ca.densify(function(*symbols))])


def c_code(routines: Sequence[Routine], name: str) -> str:
    """Return the C file that CasADi generates for some routines.

    Raises
    ------
    WideberthError : one of them needs memory to work in.
    """
    generator = ca.CodeGenerator(name, {"with_header": False})
    for routine in routines:
        generator.add(routine.function)
    # Its functions share one signature, of which each uses what it needs.
    quiet = '#if defined(__GNUC__)\n#pragma GCC diagnostic ignored "-Wunused-parameter"\n#endif\n'
    text = str(generator.dump())
    if re.search(r"\b(iw|w) *[+\[]", text):  # a call that is kept as one, with memory of its own
        raise WideberthError(
            "the problem calls a CasADi function that is not inlined; build the plug-in's "
            "functions without never_inline"
        )
    return quiet + text
