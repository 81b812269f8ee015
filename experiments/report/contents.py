"""What a report says of a result, read from its folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...framework.plugins.io import read_json, read_table
from ...framework.values.errors import WideberthError
from ..engine.base import Row
from ..engine.runner import draw, reopen
from ..engine.timing import condense_times
from .player import kept_episodes, result_tail


@dataclass(frozen=True)
class Report:
    """What a report says of one result.

    Attributes
    ----------
    name : of the folder.
    claim : what was examined.
    summary : the condensed table.
    rows : the whole table.
    times : measured times, condensed; they differ from run to run.
    pictures : PNG and GIF files, drawn if they were missing.
    episodes : files of kept episodes.
    tail : 1 - content of regions in the player.
    config : the resolved config, YAML.
    provenance : versions, commit, processor, as recorded with the result.
    """

    name: str
    claim: str
    summary: list[Row]
    rows: list[Row]
    times: list[Row]
    pictures: list[Path]
    episodes: list[Path]
    tail: float
    config: str
    provenance: dict[str, Any]


def gather(folder: Path) -> Report:
    """Read a result; draw its figures first if there are none.

    Raises
    ------
    WideberthError : not a folder, no result in it, or one that is not finished.
    """
    if folder.exists() and not folder.is_dir():
        raise WideberthError(f"{folder} is a file; wanted the folder of a result")
    experiment, result = reopen(folder)
    if not (folder / "figures").is_dir():
        draw(folder)
    drawn = sorted((folder / "figures").rglob("*"))
    return Report(
        name=folder.resolve().name,
        claim=experiment.claim,
        summary=read_table(folder / "summary.csv"),
        rows=result.rows,
        times=condense_times(result.times),
        pictures=[path for path in drawn if path.suffix in (".png", ".gif")],
        episodes=kept_episodes(folder),
        tail=result_tail(folder),
        config=(folder / "config.yaml").read_text(encoding="utf-8"),
        provenance=read_json(folder / "provenance.json", "provenance", 1),
    )


def origin(provenance: dict[str, Any]) -> str:
    """Say in one line what a result was measured with."""
    versions = provenance.get("versions") or {}
    parts = [
        f"wideberth {versions.get('wideberth')}",
        f"commit {provenance.get('commit') or 'unknown'}",
        f"source {provenance.get('source')}",
        f"Python {provenance.get('python')}",
        str(provenance.get("system")),
        str(provenance.get("cpu")),
    ]
    return ", ".join(parts)
