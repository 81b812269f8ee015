"""What a shell offers when the tab key is pressed: configs, results, rooms, plug-ins."""

from collections.abc import Iterator
from pathlib import Path

import typer

from ..engine.places import RESULTS


def configs(incomplete: str) -> Iterator[str]:
    """Yield shipped configs and YAML files."""
    from ..engine.shipped_configs import shipped

    yield from _begun(shipped(), incomplete)
    yield from _paths(incomplete, (".yaml", ".yml"))


def results(incomplete: str) -> Iterator[str]:
    """Yield the names of results under results/, and folders."""
    found = sorted(path.parent.name for path in RESULTS.glob("*/config.yaml"))
    yield from _begun(found, incomplete)
    yield from _paths(incomplete, ())


def shipped_configs(incomplete: str) -> Iterator[str]:
    """Yield shipped configs."""
    from ..engine.shipped_configs import shipped

    yield from _begun(shipped(), incomplete)


def shown(context: typer.Context, incomplete: str) -> Iterator[str]:
    """Yield columns after the word column, else shipped configs."""
    from ..engine.column_descriptions import defined_columns

    if context.params.get("result") == "column":
        yield from _begun(defined_columns(), incomplete)
    else:
        yield from shipped_configs(incomplete)


def rooms(incomplete: str) -> Iterator[str]:
    """Yield the rooms, and the word for shipped configs."""
    from ...framework.plugins.registry import ROOMS

    yield from _begun([*ROOMS, "configs"], incomplete)


def plug_ins(context: typer.Context, incomplete: str) -> Iterator[str]:
    """Yield the names in the room that stands before."""
    from ...framework.plugins.registry import names
    from ...framework.values.errors import WideberthError

    try:
        yield from _begun(names(str(context.params.get("room"))), incomplete)
    except WideberthError:  # no such room; the command will say so
        return


def predictors(incomplete: str) -> Iterator[str]:
    """Yield the predictors."""
    from ...framework.plugins.registry import names

    yield from _begun(names("predictors"), incomplete)


def described(context: typer.Context, incomplete: str) -> Iterator[str]:
    """Yield rooms and all plug-ins and configs, or those of the room that stands before."""
    from ...framework.plugins.registry import ROOMS, choices
    from ..engine.shipped_configs import shipped

    before = list(context.params.get("what") or ())
    known = {room: choices for room in ROOMS} | {"configs": lambda _: shipped()}
    inside = [room for room in known if not before or room in (before[0], f"{before[0]}s")]
    found = {name for room in inside for name in known[room](room)}
    yield from _begun(sorted(found | ({*known} if not before else set())), incomplete)


def _begun(words: list[str], incomplete: str) -> Iterator[str]:
    return (word for word in words if word.startswith(incomplete))


def _paths(incomplete: str, suffixes: tuple[str, ...]) -> Iterator[str]:
    """Yield folders, and files with these suffixes, that begin with the text."""
    folder, _, begin = incomplete.rpartition("/")
    if any(sign in incomplete for sign in "*?["):
        return
    for path in sorted(
        Path(folder or ("/" if incomplete.startswith("/") else ".")).glob(f"{begin}*")
    ):
        if path.is_dir() and not path.name.startswith("."):
            yield f"{path}/"
        elif path.suffix in suffixes:
            yield str(path)
