"""What is run of the pages from the wheel, and what is not; `make wheel COMMANDS=1` runs it."""

import re

import pytest

from wideberth.tests.house.page_commands import CLONE, ELSEWHERE, SETTINGS, commands, shortened
from wideberth.tests.house.test_pages import blocks


def test_every_reason_to_leave_a_command_out_has_one() -> None:
    shown = [command for _, command in commands()]
    assert len(shown) == len(set(shown)) > 100
    for start in ELSEWHERE:
        assert any(re.match(start, command) for command in shown), start
    assert all(blocks(page, "sh", "bash") for page in CLONE.union(SETTINGS))


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        ("wideberth run crossing --quick", "wideberth run crossing --quick"),
        ("wideberth run crossing --set seeds=10 --out results/mine",
         "wideberth run crossing --set seeds=2 --out results/mine --quick"),
        ("wideberth show crossing --latex", "wideberth show crossing --latex"),
    ],
)  # fmt: skip
def test_studies_are_short_and_leave_their_result_where_the_page_says(
    command: str, wanted: str
) -> None:
    assert shortened(command) == wanted
