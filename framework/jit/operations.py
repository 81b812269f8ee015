"""How each scalar operation of CasADi is written, as LLVM instructions and in Python for JAX.

``{0}`` and ``{1}`` are the operands and ``{out}`` is the name that the operation defines; lines
before the last define names that begin with it. Where CasADi's meaning and another's differ,
CasADi's holds: comparisons give 1.0 or 0.0, ``fmin`` and ``fmax`` pass over NaN, NaN counts as
true, ``sign`` keeps NaN and signed zeros.
"""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..numerics.symbolic import ca
from ..values.errors import WideberthError

FAST = "contract reassoc nsz arcp"
"""Sums in any order, products fused with them, and zeros without a sign; NaN and infinity keep
their meaning."""


def _sum(word: str, jax: str, operands: str = "{0}, {1}") -> tuple[str, str]:
    """Arithmetic."""
    return f"{{out}} = {word} {FAST} double {operands}", f"{{out}} = {jax}"


def _call(name: str, jax: str) -> tuple[str, str]:
    """Apply a function of one operand: of LLVM where the name has a dot, else of the C library."""
    return (
        f"{{out}} = call {FAST} double @{name}(double {{0}})",
        f"{{out}} = {jax}({{0}})",
    )


def _call_two(name: str, jax: str) -> tuple[str, str]:
    return (
        f"{{out}} = call {FAST} double @{name}(double {{0}}, double {{1}})",
        f"{{out}} = {jax}({{0}}, {{1}})",
    )


_AS_NUMBER = "\n{out} = select i1 {out}.c, double 1.0, double 0.0"


def _compare(word: str, jax: str, second: str = "{1}") -> tuple[str, str]:
    """1.0 where a comparison holds, else 0.0."""
    return (
        f"{{out}}.c = fcmp {word} double {{0}}, {second}{_AS_NUMBER}",
        f"{{out}} = jnp.where({jax}, 1.0, 0.0)",
    )


def _logical(word: str, jax: str) -> tuple[str, str]:
    """1.0 where ``word`` holds for both operands as truth values, else 0.0."""
    return (
        "{out}.a = fcmp une double {0}, 0.0\n{out}.b = fcmp une double {1}, 0.0\n"
        f"{{out}}.c = {word} i1 {{out}}.a, {{out}}.b{_AS_NUMBER}",
        f"{{out}} = jnp.where(({{0}} != 0.0) {jax} ({{1}} != 0.0), 1.0, 0.0)",
    )


def _extreme(word: str, jax: str) -> tuple[str, str]:
    """Whichever operand the comparison prefers; the other one where it is NaN."""
    return (
        f"{{out}}.a = fcmp {word} double {{0}}, {{1}}\n"
        "{out}.b = select i1 {out}.a, double {0}, double {1}\n"
        "{out}.c = fcmp oeq double {out}.b, {out}.b\n"
        "{out} = select i1 {out}.c, double {out}.b, double {0}",
        f"{{out}} = jnp.where({{0}} {jax} {{1}}, {{0}}, {{1}})\n"
        "{out} = jnp.where({out} == {out}, {out}, {0})",
    )


_SIGN = (
    """{out}.a = fcmp olt double {0}, 0.0
{out}.b = select i1 {out}.a, double -1.0, double {0}
{out}.c = fcmp ogt double {0}, 0.0
{out} = select i1 {out}.c, double 1.0, double {out}.b""",
    """{out} = jnp.where({0} < 0.0, -1.0, {0})
{out} = jnp.where({0} > 0.0, 1.0, {out})""",
)

# From the exact remainder by 2 |y|, towards zero, to that of the nearest multiple of y.
_REMAINDER = (
    """{out}.y = call double @llvm.fabs.f64(double {1})
{out}.x = call double @llvm.fabs.f64(double {0})
{out}.d = fadd double {out}.y, {out}.y
{out}.r = frem double {out}.x, {out}.d
{out}.a = fsub double {out}.r, {out}.y
{out}.b = fadd double {out}.a, {out}.a
{out}.c = fcmp oge double {out}.b, {out}.y
{out}.e = fsub double {out}.a, {out}.y
{out}.f = select i1 {out}.c, double {out}.e, double {out}.r
{out}.g = fadd double {out}.f, {out}.f
{out}.h = fcmp ogt double {out}.g, {out}.y
{out}.i = fsub double {out}.f, {out}.y
{out}.j = select i1 {out}.h, double {out}.i, double {out}.f
{out}.k = fcmp olt double {0}, 0.0
{out}.l = fneg double {out}.j
{out} = select i1 {out}.k, double {out}.l, double {out}.j""",
    """{out} = jnp.fmod(jnp.abs({0}), jnp.abs({1}) + jnp.abs({1}))
{out} = jnp.where(({out} - jnp.abs({1})) + ({out} - jnp.abs({1})) >= jnp.abs({1}),"""
    """ {out} - jnp.abs({1}) - jnp.abs({1}), {out})
{out} = jnp.where({out} + {out} > jnp.abs({1}), {out} - jnp.abs({1}), {out})
{out} = jnp.where({0} < 0.0, -{out}, {out})""",
)

_MEANINGS: Mapping[int, tuple[str, str]] = {
    ca.OP_ADD: _sum("fadd", "{0} + {1}"),
    ca.OP_SUB: _sum("fsub", "{0} - {1}"),
    ca.OP_MUL: _sum("fmul", "{0} * {1}"),
    ca.OP_DIV: _sum("fdiv", "{0} / {1}"),
    ca.OP_NEG: _sum("fneg", "-{0}", "{0}"),
    ca.OP_SQ: _sum("fmul", "{0} * {0}", "{0}, {0}"),
    ca.OP_TWICE: _sum("fadd", "{0} + {0}", "{0}, {0}"),
    ca.OP_INV: _sum("fdiv", "1.0 / {0}", "1.0, {0}"),
    ca.OP_EXP: _call("llvm.exp.f64", "jnp.exp"),
    ca.OP_EXPM1: _call("expm1", "jnp.expm1"),
    ca.OP_LOG: _call("llvm.log.f64", "jnp.log"),
    ca.OP_LOG1P: _call("log1p", "jnp.log1p"),
    ca.OP_SQRT: _call("llvm.sqrt.f64", "jnp.sqrt"),
    ca.OP_POW: _call_two("llvm.pow.f64", "jnp.power"),
    ca.OP_CONSTPOW: _call_two("llvm.pow.f64", "jnp.power"),
    ca.OP_SIN: _call("llvm.sin.f64", "jnp.sin"),
    ca.OP_COS: _call("llvm.cos.f64", "jnp.cos"),
    ca.OP_TAN: _call("tan", "jnp.tan"),
    ca.OP_ASIN: _call("asin", "jnp.arcsin"),
    ca.OP_ACOS: _call("acos", "jnp.arccos"),
    ca.OP_ATAN: _call("atan", "jnp.arctan"),
    ca.OP_ATAN2: _call_two("atan2", "jnp.arctan2"),
    ca.OP_SINH: _call("sinh", "jnp.sinh"),
    ca.OP_COSH: _call("cosh", "jnp.cosh"),
    ca.OP_TANH: _call("tanh", "jnp.tanh"),
    ca.OP_ASINH: _call("asinh", "jnp.arcsinh"),
    ca.OP_ACOSH: _call("acosh", "jnp.arccosh"),
    ca.OP_ATANH: _call("atanh", "jnp.arctanh"),
    ca.OP_ERF: _call("erf", "jax.scipy.special.erf"),
    ca.OP_HYPOT: _call_two("hypot", "jnp.hypot"),
    ca.OP_FABS: _call("llvm.fabs.f64", "jnp.abs"),
    ca.OP_FLOOR: _call("llvm.floor.f64", "jnp.floor"),
    ca.OP_CEIL: _call("llvm.ceil.f64", "jnp.ceil"),
    ca.OP_COPYSIGN: _call_two("llvm.copysign.f64", "jnp.copysign"),
    ca.OP_FMOD: ("{out} = frem double {0}, {1}", "{out} = jnp.fmod({0}, {1})"),
    ca.OP_REMAINDER: _REMAINDER,
    ca.OP_LT: _compare("olt", "{0} < {1}"),
    ca.OP_LE: _compare("ole", "{0} <= {1}"),
    ca.OP_EQ: _compare("oeq", "{0} == {1}"),
    ca.OP_NE: _compare("une", "{0} != {1}"),
    ca.OP_NOT: _compare("oeq", "{0} == 0.0", "0.0"),
    ca.OP_AND: _logical("and", "&"),
    ca.OP_OR: _logical("or", "|"),
    ca.OP_SIGN: _SIGN,
    ca.OP_FMIN: _extreme("ole", "<="),
    ca.OP_FMAX: _extreme("oge", ">="),
    ca.OP_IF_ELSE_ZERO: (
        "{out}.c = fcmp une double {0}, 0.0\n{out} = select i1 {out}.c, double {1}, double 0.0",
        "{out} = jnp.where({0} != 0.0, {1}, 0.0)",
    ),
}
"""Operation -> its texts for LLVM and for JAX."""


@dataclass(frozen=True)
class Dialect:
    """A language that the operations are written in.

    Attributes
    ----------
    position : of its texts in the table.
    written : text of an operand: of a name, or of a number as Python writes it.
    """

    position: int
    written: Callable[[str], str]

    def lines(self, operation: int, out: str, operands: Sequence[str]) -> list[str]:
        """Statements that define the name ``out``."""
        text = _MEANINGS[operation][self.position]
        names = [self.written(one) for one in operands]
        return text.format(*names, out=self.written(out)).split("\n")


def _is_name(text: str) -> bool:
    """Whether an operand is a name, such as x12; numbers are 'nan', 'inf' or have no letter."""
    return text[0] in "vpx"


def _as_llvm(text: str) -> str:
    """Names of LLVM have a sign in front; numbers are exact as the hexadecimal of their bits."""
    if _is_name(text):
        return f"%{text}"
    return "0x" + struct.pack(">d", float(text)).hex().upper()


def _as_python(text: str) -> str:
    return text if _is_name(text) else re.sub("nan|inf", r"math.\g<0>", text)


LLVM = Dialect(0, _as_llvm)
JAX = Dialect(1, _as_python)


def supported(operation: int) -> int:
    """Return the operation itself.

    Raises
    ------
    WideberthError : one that has no translation.
    """
    if operation in _MEANINGS:
        return operation
    names = (name for name in dir(ca) if name.startswith("OP_"))
    name = next((name for name in names if getattr(ca, name) == operation), str(operation))
    raise WideberthError(
        f"the CasADi operation {name} has no translation; write the expression without it (a "
        "function called inside: let CasADi inline it), or add it to framework/jit/operations.py"
    )
