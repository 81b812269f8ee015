"""`wideberth play`: an episode as a page in which one steps through it."""

from collections.abc import Mapping
from html import escape
from pathlib import Path

from ...framework.plugins.io import check_target, read_bytes, write_text
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from ...simulation.log.episode_log import Episode
from .page import MARK, PLAYER, page, template
from .player_data import packed
from .player_regions import episode_planner

TAIL = 0.05
"""1 - content of drawn regions where nobody states another."""


def play(path: Path, out: Path, tail: float | None = None) -> Path:
    """Write the page of an episode.

    Parameters
    ----------
    path : a file of `Episode.to_bytes`; see `find_episode`. Of one in the folder of its result
        the planner is known, and its regions are drawn.
    out : HTML file.
    tail : 1 - content of the drawn regions; by default that of the result, else 0.05.

    Raises
    ------
    WideberthError : no episode there; one without a robot; a tail outside (0, 1); a file that
        cannot be written, or an existing one that is no page of this package.
    """
    check_target(out, MARK)
    episode = read_episode(path)
    chosen = result_tail(path.parent.parent) if tail is None else tail
    text = packed(episode, chosen, episode_planner(path))
    title = f"{path.stem}: seed {episode.seed}, ended by {episode.ended}"
    parts = [
        "<main>",
        f"<h1>{escape(title)}</h1>",
        player({path.stem: text}, path.stem, alone=True),
        template("player.html"),
        "</main>",
    ]
    return write_text(out, page(path.stem, "\n".join(parts), PLAYER))


def player(episodes: Mapping[str, str], label: str, alone: bool = False) -> str:
    """Return the HTML of one player for packed episodes by name.

    The page needs the template player.html once, and the scripts `PLAYER`.

    Parameters
    ----------
    episodes : name -> text of `player_data.packed`.
    label : whose episodes they are.
    alone : it listens to keys anywhere in the page, not only where it has the focus.
    """
    sources = "\n".join(
        f'<script type="text/plain" class="episode" data-name="{escape(name)}">{text}</script>'
        for name, text in episodes.items()
    )
    return (
        f'<section class="player" tabindex="-1" aria-label="Player of {escape(label)}"'
        f"{' data-alone' if alone else ''}>\n"
        "<noscript><p>The player needs JavaScript; everything it needs is in this file."
        f"</p></noscript>\n{sources}\n</section>"
    )


def find_episode(path: Path) -> Path:
    """Return the file of an episode that a path or the folder of a result means.

    Raises
    ------
    WideberthError : nothing there, a result that keeps no episode, or several.
    """
    if path.is_file():
        return path
    if not path.is_dir():
        raise WideberthError(
            f"{path} does not exist; wanted an episode (files/*.npz of a result) or the folder "
            "of a result"
        )
    kept = kept_episodes(path)
    if not kept:
        raise WideberthError(f"{path} keeps no episode; wanted a file files/*.npz in it")
    if len(kept) > 1:
        names = ", ".join(file.relative_to(path).as_posix() for file in kept)
        raise WideberthError(
            f"{path} keeps {len(kept)} episodes: {names}; name one, as in "
            f"`wideberth play {kept[0]}`"
        )
    return kept[0]


def kept_episodes(folder: Path) -> list[Path]:
    """Return the files of a result that hold episodes, sorted."""
    found = []
    for path in sorted((folder / "files").rglob("*.npz")):
        try:
            read_episode(path)
        except WideberthError:
            continue  # what else an experiment left
        found.append(path)
    return found


def read_episode(path: Path) -> Episode:
    """Read an episode.

    Raises
    ------
    WideberthError : unreadable, or something else.
    """
    try:
        return Episode.from_bytes(read_bytes(path))
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from None


def result_tail(folder: Path) -> float:
    """Return the tail that a result's own figures are drawn with, else 0.05."""
    file = folder / "config.yaml"
    stated = read_config(file, stored=True).get("tail") if file.is_file() else None
    return float(stated) if isinstance(stated, int | float) and 0 < stated < 1 else TAIL
