"""How each scalar operation of CasADi is written in Python, for Numba and for JAX.

A text may have several lines; ``{0}`` and ``{1}`` are the operands, names or constants that
cost nothing to repeat, and ``{out}`` is the name that the operation defines. Where CasADi's
meaning and Python's differ, CasADi's holds: comparisons give 1.0 or 0.0, ``fmin`` and ``fmax``
pass over NaN, NaN counts as true, ``sign`` keeps NaN and signed zeros.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..numerics.symbolic import ca
from ..values.errors import WideberthError

_PLAIN: Mapping[int, str] = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_LIFT: "{0}",  # the second operand is a start value for solvers
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
}
"""What both libraries write alike."""

_CALLS: Mapping[int, tuple[str, str]] = {
    ca.OP_EXP: ("math.exp", "jnp.exp"),
    ca.OP_EXPM1: ("math.expm1", "jnp.expm1"),
    ca.OP_LOG: ("math.log", "jnp.log"),
    ca.OP_LOG1P: ("math.log1p", "jnp.log1p"),
    ca.OP_SQRT: ("math.sqrt", "jnp.sqrt"),
    ca.OP_POW: ("math.pow", "jnp.power"),
    ca.OP_CONSTPOW: ("math.pow", "jnp.power"),
    ca.OP_SIN: ("math.sin", "jnp.sin"),
    ca.OP_COS: ("math.cos", "jnp.cos"),
    ca.OP_TAN: ("math.tan", "jnp.tan"),
    ca.OP_ASIN: ("math.asin", "jnp.arcsin"),
    ca.OP_ACOS: ("math.acos", "jnp.arccos"),
    ca.OP_ATAN: ("math.atan", "jnp.arctan"),
    ca.OP_ATAN2: ("math.atan2", "jnp.arctan2"),
    ca.OP_SINH: ("math.sinh", "jnp.sinh"),
    ca.OP_COSH: ("math.cosh", "jnp.cosh"),
    ca.OP_TANH: ("math.tanh", "jnp.tanh"),
    ca.OP_ASINH: ("math.asinh", "jnp.arcsinh"),
    ca.OP_ACOSH: ("math.acosh", "jnp.arccosh"),
    ca.OP_ATANH: ("math.atanh", "jnp.arctanh"),
    ca.OP_ERF: ("math.erf", "jax.scipy.special.erf"),
    ca.OP_HYPOT: ("math.hypot", "jnp.hypot"),
    ca.OP_FABS: ("math.fabs", "jnp.abs"),
    ca.OP_COPYSIGN: ("math.copysign", "jnp.copysign"),
    ca.OP_FMOD: ("np.fmod", "jnp.fmod"),
    ca.OP_FLOOR: (
        "np.floor",
        "jnp.floor",
    ),  # math.floor of Numba is an integer, math.fmod is missing
    ca.OP_CEIL: ("np.ceil", "jnp.ceil"),
}
"""Functions that both libraries have, of one or two operands."""

_BINARY = {ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ATAN2, ca.OP_HYPOT, ca.OP_COPYSIGN, ca.OP_FMOD}

_CONDITIONS: Mapping[int, str] = {
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} == {1}",
    ca.OP_NE: "{0} != {1}",
    ca.OP_NOT: "{0} == 0.0",
    ca.OP_AND: "({0} != 0.0) & ({1} != 0.0)",
    ca.OP_OR: "({0} != 0.0) | ({1} != 0.0)",
}
"""1.0 where they hold, else 0.0."""

_CHOICES: Mapping[int, tuple[tuple[str, str, str], ...]] = {
    ca.OP_IF_ELSE_ZERO: (("{0} != 0.0", "{1}", "0.0"),),
    ca.OP_SIGN: (("{0} < 0.0", "-1.0", "{0}"), ("{0} > 0.0", "1.0", "{out}")),
    ca.OP_FMIN: (("{0} <= {1}", "{0}", "{1}"), ("{out} == {out}", "{out}", "{0}")),
    ca.OP_FMAX: (("{0} >= {1}", "{0}", "{1}"), ("{out} == {out}", "{out}", "{0}")),
    # From the exact remainder by 2 |y|, towards zero, to that of the nearest multiple of y.
    ca.OP_REMAINDER: (
        (
            "({out} - {fabs}({1})) + ({out} - {fabs}({1})) >= {fabs}({1})",
            "{out} - {fabs}({1}) - {fabs}({1})",
            "{out}",
        ),
        ("{out} + {out} > {fabs}({1})", "{out} - {fabs}({1})", "{out}"),
        ("{0} < 0.0", "-{out}", "{out}"),
    ),
}
"""Lines of (condition, value where it holds, value elsewhere), one after the other."""

_BEFORE: Mapping[int, str] = {
    ca.OP_REMAINDER: "{out} = {fmod}({fabs}({0}), {fabs}({1}) + {fabs}({1}))",
}
"""What stands before the choices."""


@dataclass(frozen=True)
class Dialect:
    """A library that the operations are written for.

    Attributes
    ----------
    position : of its names in the table of functions.
    choice : text of a value that depends on a condition, of ``{condition}``, ``{yes}``, ``{no}``.
    """

    position: int
    choice: str

    def lines(self, operation: int, out: str, operands: Sequence[str]) -> list[str]:
        """Statements that define the name ``out``."""
        if operation in _PLAIN:
            texts = ["{out} = " + _PLAIN[operation]]
        elif operation in _CALLS:
            arguments = "({0}, {1})" if operation in _BINARY else "({0})"
            texts = ["{out} = " + _CALLS[operation][self.position] + arguments]
        elif operation in _CONDITIONS:
            texts = [self._chosen(_CONDITIONS[operation], "1.0", "0.0")]
        else:
            texts = [self._chosen(*choice) for choice in _CHOICES[operation]]
            if operation in _BEFORE:
                texts.insert(0, _BEFORE[operation])
        fmod, fabs = _CALLS[ca.OP_FMOD][self.position], _CALLS[ca.OP_FABS][self.position]
        return [text.format(*operands, out=out, fmod=fmod, fabs=fabs) for text in texts]

    def _chosen(self, condition: str, yes: str, no: str) -> str:
        return "{out} = " + self.choice.format(condition=condition, yes=yes, no=no)


NUMBA = Dialect(0, "choose({condition}, {yes}, {no})")
JAX = Dialect(1, "jnp.where({condition}, {yes}, {no})")


def supported(operation: int) -> int:
    """Return the operation itself.

    Raises
    ------
    WideberthError : one that has no translation.
    """
    if any(operation in table for table in (_PLAIN, _CALLS, _CONDITIONS, _CHOICES)):
        return operation
    names = (name for name in dir(ca) if name.startswith("OP_"))
    name = next((name for name in names if getattr(ca, name) == operation), str(operation))
    raise WideberthError(
        f"the CasADi operation {name} has no translation; write the expression without it (a "
        "function called inside: let CasADi inline it), or add it to framework/jit/operations.py"
    )
