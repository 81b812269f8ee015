"""The mutation study's changes: what is changed, what is left alone, and that nothing else is."""

import ast

import numpy as np
import pytest

from wideberth.metrics import ellipses, motion
from wideberth.tests.mutation import areas, forked
from wideberth.tests.mutation.sites import changed, sites
from wideberth.tests.mutation.study import stale

SOURCE = '''"""Words 1."""
from math import pi
LIMIT: float = 1e-9
class Box:
    """More words."""
    side: int = 2
    def area(self, scale: float = 1.0) -> float:
        """Scale 3."""
        if self.side < 0:
            raise ValueError(f"side is {self.side + 1}")
        return -scale * self.side ** 2 if self.side and scale else max(LIMIT, 0.0)
'''

WANTED = {
    ("", "1e-09 -> 1e-05"), ("Box", "2 -> 3"), ("Box.area", "1.0 -> 2.0"),
    ("Box.area", "if self.side < 0 -> if False"), ("Box.area", "self.side < 0 -> self.side >= 0"),
    ("Box.area", "self.side < 0 -> self.side <= 0"), ("Box.area", "0 -> 1"),
    ("Box.area", "self.side and scale -> self.side or scale"),
    ("Box.area", "-scale -> scale"), ("Box.area", "2 -> 3"),
    ("Box.area", "-scale * self.side ** 2 -> -scale / self.side ** 2"),
    ("Box.area", "self.side ** 2 -> self.side * 2"),
    ("Box.area", "max(LIMIT, 0.0) -> min(LIMIT, 0.0)"), ("Box.area", "0.0 -> 1.0"),
}  # fmt: skip


def test_every_number_sign_comparison_and_branch_is_changed() -> None:
    found = sites("box.py", SOURCE)
    short = {(one.owner, one.text.split(" | ")[1]) for one in found}
    branches = {pair for pair in short if " if self.side and " in pair[1]}
    assert short - branches == WANTED and len(branches) == 2
    assert len({str(one) for one in found}) == len(found)
    assert {one.names for one in found if not one.owner} == {("LIMIT",)}
    assert {one.names for one in found if one.owner == "Box"} == {("side",)}


def test_any_number_below_zero_reshapes_the_same() -> None:
    found = [one.text.split(" | ")[1] for one in sites("box.py", "a = b.reshape(-1, f(-1))")]
    assert found == ["-1 -> 1", "-1 -> 1 #2", "1 -> 2"]


def test_one_change_leaves_all_else_as_it_was() -> None:
    before = ast.unparse(ast.parse(SOURCE)).splitlines()
    for one in sites("box.py", SOURCE):
        after = ast.unparse(changed(SOURCE, one.number)).splitlines()
        assert len(after) == len(before), str(one)
        assert sum(a != b for a, b in zip(before, after, strict=True)) == 1, str(one)


def test_all_modules_can_be_changed() -> None:
    modules = {
        path: (areas.ROOT / path).read_text() for a in areas.AREAS for path in areas.paths(a)
    }
    drawn = areas.draw(modules, 7, 36)
    assert drawn == areas.draw(modules, 7, 36) and drawn != areas.draw(modules, 8, 36)
    assert [area for area, _ in drawn] == [*areas.AREAS] * 3
    for _, one in drawn:
        compile(changed(modules[one.path], one.number), one.path, "exec")


def test_changes_are_drawn_from_the_areas_that_are_named() -> None:
    named = ["routes", "identities"]
    modules = {path: (areas.ROOT / path).read_text() for a in named for path in areas.paths(a)}
    drawn = areas.draw(modules, 7, 5, named)
    assert [area for area, _ in drawn] == ["routes", "identities"] * 2 + ["routes"]


def test_a_function_gets_its_new_code_wherever_it_is_known() -> None:
    """And its old code back."""
    path, area = "metrics/ellipses.py", ellipses.sum_volume
    source = (areas.ROOT / path).read_text()
    site = next(one for one in sites(path, source) if one.owner == "sum_volume")
    old, given = area.__code__, (np.array([2.0, 1.0]), np.array(0.5))
    before = area(*given)
    try:
        assert forked.given(site, compile(changed(source, site.number), "changed", "exec"))
        assert area.__code__ is not old
    finally:
        area.__code__ = old
    assert area(*given) == before


def test_a_changed_default_is_left_to_a_new_import() -> None:
    """The code is the same with it and without."""
    path = "metrics/motion.py"
    source = (areas.ROOT / path).read_text()
    mine = [one for one in sites(path, source) if one.owner == "course_change"]
    default = next(one for one in mine if "0.001 ->" in one.text)
    before = motion.course_change.__code__
    assert not forked.given(default, compile(changed(source, default.number), "changed", "exec"))
    assert motion.course_change.__code__ is before


@pytest.mark.parametrize("area", areas.AREAS)
def test_every_name_of_an_area_is_a_module(area: str) -> None:
    for name in areas.AREAS[area]:
        assert list(areas.ROOT.glob(name)), name


def test_every_part_of_a_name_is_that_of_a_test_file() -> None:
    folders = (areas.ROOT / "tests", areas.ROOT / "packages")
    names = [one.name for folder in folders for one in folder.rglob("test_*.py")]
    for part in areas.TESTS:
        assert any(f"test_{part}" in name for name in names), part


def test_every_known_survivor_is_a_change() -> None:
    assert list(stale({})) == []


def test_a_statement_that_defines_several_names_is_reached_by_each() -> None:
    found = sites("a.py", "FEW, MANY = 1, 2\nBOX = KIND = 3\n")
    assert [one.names for one in found] == [("FEW", "MANY")] * 2 + [("BOX", "KIND")]
