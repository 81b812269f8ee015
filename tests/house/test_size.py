"""The code keeps within its budget."""

from pathlib import Path

from wideberth.tests.house.size import code_lines, limits, sizes


def test_the_code_keeps_within_its_budget() -> None:
    """A change that adds code removes code: a limit may be lowered, never raised."""
    found, allowed = sizes(), limits()
    assert found.keys() == allowed.keys()
    above = {name: (found[name], allowed[name]) for name in found if found[name] > allowed[name]}
    assert not above, f"(lines of code, limit): {above}"


def test_comments_docstrings_and_blank_lines_do_not_count(tmp_path: Path) -> None:
    file = tmp_path / "sample.py"
    file.write_text(
        '"""What it is.\n\nMore."""\n\n# why\nLIMIT = 3  # m\n"""Of something."""\n\n'
        'def text() -> str:\n    """Return it."""\n    return """two\n    lines"""\n'
    )
    assert code_lines(file) == 4
