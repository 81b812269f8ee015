"""How each scalar operation of CasADi is written as LLVM instructions.

``{0}`` and ``{1}`` are the operands and ``{out}`` is the name that the operation defines; lines
before the last define names that begin with it. Where CasADi's meaning and LLVM's differ,
CasADi's holds: comparisons give 1.0 or 0.0, ``fmin`` and ``fmax`` pass over NaN, NaN counts as
true, ``sign`` keeps NaN and signed zeros.
"""

import struct
from collections.abc import Mapping, Sequence

from ..numerics.symbolic import ca

FAST = "contract reassoc nsz arcp"
"""Sums in any order, products fused with them, and zeros without a sign; NaN and infinity keep
their meaning."""


def _arithmetic(word: str, operands: str = "{0}, {1}") -> str:
    return f"{{out}} = {word} {FAST} double {operands}"


def _call(name: str) -> str:
    """Apply a function of one operand: of LLVM where the name has a dot, else of the C library."""
    return f"{{out}} = call {FAST} double @{name}(double {{0}})"


def _call_two(name: str) -> str:
    return f"{{out}} = call {FAST} double @{name}(double {{0}}, double {{1}})"


_AS_NUMBER = "\n{out} = select i1 {out}.c, double 1.0, double 0.0"


def _compare(word: str, second: str = "{1}") -> str:
    """1.0 where a comparison holds, else 0.0."""
    return f"{{out}}.c = fcmp {word} double {{0}}, {second}{_AS_NUMBER}"


def _logical(word: str) -> str:
    """1.0 where ``word`` holds for both operands as truth values, else 0.0."""
    return (
        "{out}.a = fcmp une double {0}, 0.0\n{out}.b = fcmp une double {1}, 0.0\n"
        f"{{out}}.c = {word} i1 {{out}}.a, {{out}}.b{_AS_NUMBER}"
    )


def _extreme(word: str) -> str:
    """Whichever operand the comparison prefers; the other one where it is NaN."""
    return (
        f"{{out}}.a = fcmp {word} double {{0}}, {{1}}\n"
        "{out}.b = select i1 {out}.a, double {0}, double {1}\n"
        "{out}.c = fcmp oeq double {out}.b, {out}.b\n"
        "{out} = select i1 {out}.c, double {out}.b, double {0}"
    )


_SIGN = """{out}.a = fcmp olt double {0}, 0.0
{out}.b = select i1 {out}.a, double -1.0, double {0}
{out}.c = fcmp ogt double {0}, 0.0
{out} = select i1 {out}.c, double 1.0, double {out}.b"""

# From the exact remainder by 2 |y|, towards zero, to that of the nearest multiple of y.
_REMAINDER = """{out}.y = call double @llvm.fabs.f64(double {1})
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
{out} = select i1 {out}.k, double {out}.l, double {out}.j"""

_INSTRUCTIONS: Mapping[int, str] = {
    ca.OP_ADD: _arithmetic("fadd"),
    ca.OP_SUB: _arithmetic("fsub"),
    ca.OP_MUL: _arithmetic("fmul"),
    ca.OP_DIV: _arithmetic("fdiv"),
    ca.OP_NEG: _arithmetic("fneg", "{0}"),
    ca.OP_SQ: _arithmetic("fmul", "{0}, {0}"),
    ca.OP_TWICE: _arithmetic("fadd", "{0}, {0}"),
    ca.OP_INV: _arithmetic("fdiv", "1.0, {0}"),
    ca.OP_EXP: _call("llvm.exp.f64"),
    ca.OP_EXPM1: _call("expm1"),
    ca.OP_LOG: _call("llvm.log.f64"),
    ca.OP_LOG1P: _call("log1p"),
    ca.OP_SQRT: _call("llvm.sqrt.f64"),
    ca.OP_POW: _call_two("llvm.pow.f64"),
    ca.OP_CONSTPOW: _call_two("llvm.pow.f64"),
    ca.OP_SIN: _call("llvm.sin.f64"),
    ca.OP_COS: _call("llvm.cos.f64"),
    ca.OP_TAN: _call("tan"),
    ca.OP_ASIN: _call("asin"),
    ca.OP_ACOS: _call("acos"),
    ca.OP_ATAN: _call("atan"),
    ca.OP_ATAN2: _call_two("atan2"),
    ca.OP_SINH: _call("sinh"),
    ca.OP_COSH: _call("cosh"),
    ca.OP_TANH: _call("tanh"),
    ca.OP_ASINH: _call("asinh"),
    ca.OP_ACOSH: _call("acosh"),
    ca.OP_ATANH: _call("atanh"),
    ca.OP_ERF: _call("erf"),
    ca.OP_HYPOT: _call_two("hypot"),
    ca.OP_FABS: _call("llvm.fabs.f64"),
    ca.OP_FLOOR: _call("llvm.floor.f64"),
    ca.OP_CEIL: _call("llvm.ceil.f64"),
    ca.OP_COPYSIGN: _call_two("llvm.copysign.f64"),
    ca.OP_FMOD: "{out} = frem double {0}, {1}",
    ca.OP_REMAINDER: _REMAINDER,
    ca.OP_LT: _compare("olt"),
    ca.OP_LE: _compare("ole"),
    ca.OP_EQ: _compare("oeq"),
    ca.OP_NE: _compare("une"),
    ca.OP_NOT: _compare("oeq", "0.0"),
    ca.OP_AND: _logical("and"),
    ca.OP_OR: _logical("or"),
    ca.OP_SIGN: _SIGN,
    ca.OP_FMIN: _extreme("ole"),
    ca.OP_FMAX: _extreme("oge"),
    ca.OP_IF_ELSE_ZERO: (
        "{out}.c = fcmp une double {0}, 0.0\n{out} = select i1 {out}.c, double {1}, double 0.0"
    ),
}


def exactly(source: str) -> str:
    """Return the source of functions without leave to round otherwise."""
    return source.replace(f" {FAST}", "")


def instructions(operation: int, out: str, operands: Sequence[str]) -> list[str]:
    """Instructions that define the name ``out``."""
    names = [operand_text(one) for one in operands]
    return _INSTRUCTIONS[operation].format(*names, out=operand_text(out)).split("\n")


def operand_text(operand: str) -> str:
    """Write a name, such as x12, or a number as Python writes it, as LLVM does.

    Names of LLVM have a sign in front; numbers are exact as the hexadecimal of their bits.
    """
    if operand[0] in "vpx":  # numbers are 'nan', 'inf' or have no letter
        return f"%{operand}"
    return "0x" + struct.pack(">d", float(operand)).hex().upper()
