"""One named test per plug-in and law."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import pytest
from _pytest.mark import ParameterSet

from wideberth.framework.testing.laws import Law


@dataclass(frozen=True, eq=False)
class Contract:
    """The laws of several plug-ins.

    Attributes
    ----------
    plugins : makers by the name that stands in the test's name.
    laws : of a plug-in; cheap before a law is checked.
    exceptions : reason by (plug-in, law), for laws that it is not held to here. The plug-in's own
        exceptions stand in its laws.
    """

    plugins: Mapping[str, Callable[[], Any]]
    laws: Callable[[Any], tuple[Law, ...]]
    exceptions: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @classmethod
    def of(cls, plugins: Iterable[Any], laws: Callable[[Any], tuple[Law, ...]]) -> "Contract":
        """Return the contract of frozen plug-ins, each with its repr for a name."""
        return cls({repr(one): partial(_itself, one) for one in plugins}, laws)

    def cases(self) -> list[ParameterSet]:
        """Return (name, law) for `pytest.mark.parametrize`; exceptions are skipped."""
        unused, found = dict(self.exceptions), []
        for name, make in self.plugins.items():
            for law in self.laws(make()):
                reason = unused.pop((name, law.name), law.exception)
                marks = [pytest.mark.skip(reason=reason)] if reason else []
                case = pytest.param(name, law.name, id=f"{name}-{law.name}", marks=marks)
                found.append(case)
        if unused:
            raise ValueError(f"exceptions for laws that nobody has: {sorted(unused)}")
        return found

    def check(self, name: str, law: str) -> None:
        """Check one law; the laws of one plug-in share what they compute."""
        _laws(self, name)[law].check()


def _itself(plugin: Any) -> Any:
    return plugin


@lru_cache(maxsize=2)
def _laws(contract: Contract, name: str) -> dict[str, Law]:
    return {law.name: law for law in contract.laws(contract.plugins[name]())}
