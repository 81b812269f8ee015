# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

__all__ = []
BUILT_IN: dict[str, str]
