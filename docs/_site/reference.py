"""The pages of the reference, of the groups that docs/reference.yaml lists.

They are written from the registry and the lists of public names, so that a new plug-in stands in
the reference without an edit here.
"""

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import yaml

from wideberth.framework.plugins.registry import ROOMS, load, names

from . import DOCS, page, write
from .docstrings import escaped

KINDS = {"class": inspect.isclass, "function": inspect.isfunction}


@dataclass(frozen=True)
class Entry:
    """One name of the reference.

    Attributes
    ----------
    path : where it is imported from, as in ``wideberth.Tracks``.
    found : the object.
    config_name : its name in configs, or "".
    """

    path: str
    found: Any
    config_name: str = ""

    @property
    def page(self) -> str:
        return self.path.removeprefix("wideberth.")

    @property
    def line(self) -> str:
        return escaped((inspect.getdoc(self.found) or "").split("\n")[0])


@dataclass(frozen=True)
class Group:
    """A page of the reference: title, a sentence, entries."""

    name: str
    title: str
    text: str
    entries: tuple[Entry, ...]


def groups() -> list[Group]:
    """Collect every public name, by group; what has a group by name or room is in no other."""
    listed = yaml.safe_load((DOCS / "reference.yaml").read_text(encoding="utf-8"))
    entries: dict[str, tuple[Entry, ...]] = {}
    for group in sorted(listed, key=lambda one: ("offered" in one, "bases" in one)):
        taken = {id(entry.found): entry.found for found in entries.values() for entry in found}
        entries[group["name"]] = tuple(entries_of(group, taken))
    return [Group(one["name"], one["title"], one["text"], entries[one["name"]]) for one in listed]


def entries_of(group: dict[str, Any], taken: dict[int, Any]) -> Iterator[Entry]:
    """Yield the entries of a group, without offered ones and bases that are taken."""
    if group["name"] in ROOMS:
        yield from (plugin_entry(group["name"], name) for name in names(group["name"]))
    for module, chosen in group.get("names", {}).items():
        for name in chosen:
            yield Entry(f"{module}.{name}", getattr(import_module(module), name))
    kinds = [KINDS[group["kind"]]] if "kind" in group else KINDS.values()
    for module in group.get("offered", ()):
        for name in sorted(import_module(module).__all__):
            found = getattr(import_module(module), name)
            if any(kind(found) for kind in kinds) and id(found) not in taken:
                yield Entry(f"{module}.{name}", found)
    classes = [found for found in taken.values() if inspect.isclass(found) and "bases" in group]
    for base in sorted({base for one in classes for base in one.__mro__}, key=str):
        if base.__module__.startswith("wideberth") and id(base) not in taken:
            yield Entry(f"{base.__module__}.{base.__name__}", base)


def plugin_entry(room: str, name: str) -> Entry:
    """Return a plug-in, from where a script would import it."""
    found = load(room, name)
    module = ROOMS[room].module or found.__module__.rpartition(".")[0]
    offered = getattr(import_module(module), "__all__", ())
    home = module if found.__name__ in offered else found.__module__
    return Entry(f"{home}.{found.__name__}", found, name)


def write_pages() -> None:
    """Write the reference's sources."""
    found = [group for group in groups() if group.entries]
    texts = {"index.rst": page("reference", "Reference", groups=found), "commands.md": commands()}
    for group in found:
        texts[f"{group.name}.rst"] = page("group", group.title, group=group)
        for entry in group.entries:
            kind = "class" if inspect.isclass(entry.found) else "function"
            texts[f"{entry.page}.rst"] = page(
                "entry", entry.found.__name__, entry=entry, group=group, kind=kind
            )
    write(DOCS / "auto" / "reference", texts)


def commands() -> str:
    """Return the page of the command line, from the command line itself."""
    from typer import Context
    from typer.cli import get_docs_for_click
    from typer.main import get_command

    from wideberth.experiments.cli.app import app

    group = get_command(app)
    text = get_docs_for_click(obj=group, ctx=Context(group), name="wideberth")
    return text.replace("# `wideberth`", "# Command line", 1)
