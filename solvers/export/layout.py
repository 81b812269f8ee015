"""How the vectors of the exported problem are laid out, and its numbers as C text."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...framework.mpc.ocp.problem import Parameters, Problem, Slots
from ...framework.mpc.ocp.transcription import Guess, Transcription
from ...framework.numerics.symbolic import ca
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError

Define = tuple[str, Any, str]
"""Name after the prefix, value, and what it is."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Sizes and offsets of a problem and of its flat form.

    Attributes
    ----------
    problem : the stage-wise problem.
    parameters : of any one instance, which has the sizes.
    """

    problem: Problem
    parameters: Parameters

    @cached_property
    def form(self) -> Transcription:
        """The flat NLP: x_0 is a parameter, and a shared level one variable in front."""
        return Transcription(self.problem, staged=False, symbol=ca.SX)

    @cached_property
    def where(self) -> Guess:
        """A point whose entries are their own places among the variables."""
        places = np.arange(len(self.form.lower), dtype=np.float64)
        return self.form.unpack(places, self.parameters)

    def first(self, name: str | int) -> list[int]:
        """Where a piece begins among the variables, stage by stage, i = 0..N; -1: nowhere.

        Parameters
        ----------
        name : states, inputs, slack, or auxiliaries of a kind of slots by its number.
        """
        named = {
            "states": self.where.states,
            "inputs": self.where.inputs,
            "slack": self.where.slack,
        }
        pieces = self.where.auxiliaries[name] if isinstance(name, int) else named[name]
        flat = pieces.reshape(len(pieces), -1)
        if not flat.shape[1] or (name == "slack" and not self.problem.slacks):
            return [-1] * (self.problem.horizon + 1)
        found = [int(value) for value in flat[:, 0]]
        if name == "states":
            return [-1, *found[1:]]
        return [*found, -1] if name == "inputs" else [-1, *found]

    def rows(self) -> list[int]:
        """Where the rows of each stage begin, i = 0..N, and their number at the end."""
        return [0, *np.cumsum([size[2] for size in self.form.sizes]).tolist()]

    def constants(self) -> list[Define]:
        """Sizes and offsets that the header defines."""
        problem = self.problem
        head, states = problem.head_width, problem.states
        begin = np.cumsum([head, *(one.count * one.size for one in problem.slots)]).tolist()
        return [
            ("HORIZON", problem.horizon, "N, steps"),
            ("DIMENSION", problem.dimension, "D, of the world"),
            ("STATES", states, "n"),
            ("INPUTS", problem.inputs, "m"),
            ("HEADING", -1 if problem.heading is None else problem.heading,
             "which state is the heading, which may be shifted by full turns; -1: none"),
            ("SHARED_LEVEL", int(problem.shared),
             "1: one level for all slots is a decision variable; 0: each slot has its own"),
            ("SLACKS", problem.slacks, "slack variables per stage"),
            ("INPUT_CONSTRAINTS", problem.input_constraints.numel_out(0), "rows"),
            ("STATE_CONSTRAINTS", problem.state_constraints.numel_out(0), "rows"),
            ("TERMINAL_CONSTRAINTS", problem.terminal_constraints.numel_out(0), "rows"),
            *(constant for one in problem.slots for constant in _slot_constants(one)),
            ("HEAD_SIZE", head, "numbers of a stage that belong to no slot"),
            *((f"STAGE_{one.name.upper()}S", first,
               f"where the {one.name} slots begin in a stage")
              for one, first in zip(problem.slots, begin, strict=False)),
            ("STAGE_SIZE", problem.stage_width, "numbers of one stage"),
            ("PARAMETER_INITIAL", 0, "where x_0 stands among the parameters"),
            ("PARAMETER_TARGET", states, "the level that a shared one is drawn to; else unused"),
            ("PARAMETER_STAGES", states + 1, "where stage 1 begins"),
            ("PARAMETERS", states + 1 + problem.horizon * problem.stage_width, "all of them"),
            ("VARIABLES", len(self.form.lower), "of the NLP"),
            ("ROWS", len(self.form.row_lower), "constraints of the NLP"),
        ]  # fmt: skip

    def tables(self) -> list[Define]:
        """Arrays of integers that say where things stand, i = 0..N; -1: nowhere."""
        named: dict[str, tuple[str | int, str]] = {
            "states": ("states", "x_i; x_0 is a parameter"),
            "inputs": ("inputs", "u_i, i < N"),
            **{
                auxiliary_table(k, one): (k, f"the auxiliaries of the {one.name}s, slot by slot")
                for k, one in enumerate(self.problem.slots)
            },
            "slacks": ("slack", "the slack"),
        }
        tables: list[Define] = [
            (f"nlp_{name}", self.first(source), text) for name, (source, text) in named.items()
        ]
        return [*tables, ("nlp_first_row", self.rows(), "the rows of stage i; then their number")]


def auxiliary_table(place: int, slots: Slots) -> str:
    """Name of the table that says where the auxiliaries of a kind of slots begin."""
    return f"{slots.name}_auxiliaries" if place else "auxiliaries"


def _slot_constants(slots: Slots) -> list[Define]:
    name, width, own = slots.name.upper(), slots.width, len(slots.auxiliary)
    return [
        (f"{name}S", slots.count, "slots"),
        (f"{name}_AUXILIARIES", own, "extra variables per slot and stage"),
        (f"{name}_INEQUALITIES", slots.constraint.numel_out(0), "rows of a slot, each >= 0"),
        (f"{name}_EQUALITIES", slots.constraint.numel_out(1), "rows of a slot, each == 0"),
        (f"{name}_PARAMETERS", width, "of the region, first among the numbers of a slot"),
        (f"{name}_LEVEL", width if slots.levelled else -1, "where its level stands; -1: none"),
        (f"{name}_ACTIVE", slots.active, "where 1 (used) or 0 (empty) stands"),
        (f"{name}_GUESS", slots.guess, "where the guess of its auxiliaries begins"),
        (f"{name}_SIZE", slots.size, "numbers of one slot"),
    ]


def identifiers(names: Iterable[str]) -> list[str]:
    """Return C names, upper case and all different, for names of any kind.

    Examples
    --------
    >>> identifiers(["v", "yaw rate", "V", "φ"])
    ['V', 'YAW_RATE', 'V_2', 'E3']
    """
    found: list[str] = []
    for i, name in enumerate(names):
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").upper() or f"E{i}"
        found.append(plain if plain not in found else f"{plain}_{i}")
    return found


def number(value: float) -> str:
    """Return a float as C reads it back exactly.

    Raises
    ------
    WideberthError : not a number.
    """
    if np.isnan(value):
        raise WideberthError(
            "the example's instance holds a value that is not a number: the plug-ins must be "
            "finite at the planner's starting point; nothing was written"
        )
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def c_array(kind: str, name: str, values: Sequence[Any] | Array) -> str:
    """Return the definition of an array; C has none without an element, so it gets a 0."""
    texts = [str(v) if kind == "int" else number(float(v)) for v in values] or ["0"]
    lines, line = [], "   "
    for text in texts:
        if len(line) + len(text) > 94:
            lines.append(line)
            line = "   "
        line += f" {text},"
    body = "\n".join([*lines, line]).rstrip(",")
    return f"const {kind} {name}[{len(texts)}] = {{\n{body}\n}};\n"
