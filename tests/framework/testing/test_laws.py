"""How laws are stated: by marked methods, checked on every case, alone or together."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from inspect import signature

import numpy as np
import pytest

from wideberth.framework import testing
from wideberth.framework.plugins.extras import from_extra
from wideberth.framework.testing.laws import (
    CHECKS,
    Contract,
    Law,
    findings,
    law,
    laws_of,
    refusing,
    require,
    serving,
    stated,
)
from wideberth.framework.values.errors import MissingLibraryError, WideberthError
from wideberth.predictors.kalman import Kalman
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.scenarios.crossing import Crossing

DRAWN: list[float] = []


@dataclass(frozen=True)
class Case:
    """A plug-in, which is a number here, and a number to compare it with."""

    plugin: float
    other: int

    @law("is no smaller")
    def check_size(self) -> None:
        assert self.plugin >= self.other, f"it is smaller than {self.other}"

    @law("is whole", int, "it is a fraction")
    def check_whole(self) -> None:
        assert self.plugin % 1 == 0

    @law("draws", lambda plugin: plugin > 0, "it is negative")
    def check_drawn(self, rng: np.random.Generator) -> None:
        DRAWN.append(float(rng.random()))

    def helper(self) -> None:
        raise AssertionError("no law")


MADE: list[int] = []


@Contract
def check_number(plugin: float, *, most: int = 3) -> Iterator[Law]:
    """Check a number."""

    def cases() -> Iterator[Case]:
        for other in range(most):
            MADE.append(other)
            yield Case(plugin, other)

    return stated(Case, plugin, cases, np.random.default_rng(0))


def test_laws_stand_in_the_order_of_the_methods_and_make_no_case() -> None:
    MADE.clear()
    found = check_number.laws(5)
    assert [law.name for law in found] == ["is no smaller", "is whole", "draws"]
    assert [law.exception for law in found] == ["", "", ""] and not MADE
    assert [law.exception for law in check_number.laws(-0.5)] == [
        "", "it is a fraction", "it is negative"
    ]  # fmt: skip
    assert check_number.__doc__ == "Check a number."
    assert str(signature(check_number)) == "(plugin: float, *, most: int = 3) -> None"


def test_a_law_is_checked_on_every_case_and_broken_ones_are_named() -> None:
    check_number(2)
    assert MADE[-3:] == [0, 1, 2]
    with pytest.raises(AssertionError, match=r"^is no smaller: it is smaller than 1"):
        check_number(0.5)
    check_number(0.5, most=1)


def test_a_law_draws_the_same_whether_others_are_checked_or_not() -> None:
    DRAWN.clear()
    check_number.laws(1)[2].check()
    alone = list(DRAWN)
    DRAWN.clear()
    for one in check_number.laws(1):
        if one.name != "is no smaller":
            one.check()
    assert DRAWN == alone and len({*alone}) == 3


def test_what_is_raised_breaks_a_law() -> None:
    with pytest.raises(
        AssertionError,
        match=rf"^it raised KeyError: 'x' \({re.escape(__file__)}, line \d+\), in the rain$",
    ):
        with serving("it", ", in the rain"):
            raise KeyError("x")
    with pytest.raises(AssertionError, match=r"^as it is$"), serving("it"):
        raise AssertionError("as it is")


def test_one_cause_is_one_line_with_the_names_of_all_laws_that_it_breaks() -> None:
    def raising(remark: str, key: str = "x") -> None:
        with serving("it", remark):
            raise KeyError(key)

    def bare() -> None:
        raise KeyError("x")

    def different() -> None:
        raise AssertionError("2 is odd")

    laws = [
        Law("first", partial(raising, " at noon")),
        Law("second", different),
        Law("third", partial(raising, " at dawn")),
        Law("fourth", bare),
        Law("fifth", partial(raising, "", "y")),
        Law("sixth", partial(raising, "")),
    ]
    with pytest.raises(AssertionError) as caught:
        require(laws)
    here = rf"\({re.escape(__file__)}, line \d+\)"
    wanted = [
        rf"first: it raised KeyError: 'x' {here} at noon; also: third, sixth",
        r"second: 2 is odd",
        rf"fourth: raised KeyError: 'x' {here}",
        rf"fifth: it raised KeyError: 'y' {here}",
    ]
    assert re.fullmatch("\n".join(wanted), str(caught.value)), caught.value


def test_wrong_use_has_to_be_refused() -> None:
    with refusing("a number"):
        raise WideberthError("wanted a text")
    with pytest.raises(AssertionError, match=r"^a number: wrong use is accepted without a word"):
        with refusing("a number"):
            pass
    with pytest.raises(AssertionError, match=r"^a number: wrong use raised TypeError: no text"):
        with refusing("a number"):
            raise TypeError("no text")


def test_a_plug_in_whose_fields_can_be_set_breaks_a_law() -> None:
    """It is a copy of a shipped one, so that it keeps all others."""

    @dataclass
    class Changeable(Crossing.__mro__[1]):  # type: ignore[misc]
        build = Crossing.build

    checks = {"predictor": Kalman(), "robot": Unicycle(), "scenario": Crossing()}
    for kind, plugin in checks.items():
        (frozen,) = (one for one in laws_of(kind, plugin) if one.name == "frozen")
        frozen.check()
    (frozen,) = (one for one in laws_of("scenario", Changeable()) if one.name == "frozen")
    with pytest.raises(AssertionError, match="Changeable can be changed"):
        frozen.check()


STATEFUL = {"check_controller", "check_detector", "check_tracker", "check_state_estimator"}
PARTICULAR = {"check_level", "check_region", "check_scenario"}  # they take only plug-ins of theirs


@pytest.mark.parametrize("check", sorted({*CHECKS} - STATEFUL - PARTICULAR))
def test_values_of_every_kind_are_frozen(check: str) -> None:
    @dataclass
    class Changeable:
        speed: float = 1.0

    laws = {one.name: one for one in getattr(testing, check).laws(Changeable())}
    with pytest.raises(AssertionError, match="Changeable can be changed"):
        laws["frozen"].check()


def test_a_library_that_is_missing_breaks_no_law() -> None:
    """It is named once, by the error that states the extra, however deep that lies."""

    def first() -> None:
        with serving("fit"):
            from_extra("no_such_library", "learning", "to fit needs it")

    with pytest.raises(MissingLibraryError, match=r"pip install 'wideberth\[learning\]'"):
        list(findings([Law("first", first), Law("second", first)]))
