"""The summary of the prediction benchmark: means over the scenes, and notes on each."""

from collections.abc import Mapping

import numpy as np

from ...metrics.statistics import known_mean
from ...predictors.data.recordings import doubts
from ..engine.base import Row
from ..engine.closed_loop import column, group
from .fitting import AS_GIVEN, FITTED, UNFITTED
from .region_family import rounded

MEANS = {
    "ade_m": "error_m",
    "fde_m": "final_m",
    **{name: name for name in ("nll", "energy_m", "cover_50", "cover_90", "cover_95")},
    **{name: name for name in ("all_95", "joint_95", "fell_back")},
}
"""Columns of the summary that are means over the scenes -> columns of the table."""
AREAS = ("area_m2", "area_90_m2", "area_mean_m2")
"""Columns of the table whose mean over the scenes, at the last step, is in the summary."""


def summarised(rows: list[Row]) -> list[Row]:
    """Means over the primary scenes by predictor, then every predictor scene by scene.

    The means are left out where there is but one primary scene. ``cover_95_steps`` are the
    extremes over the steps: of the mean over the scenes in the first lines, of the scene in
    the others. ``cover_95_NAME`` is the coverage of a class of speed, over all steps and the
    scenes that have it. The areas are those of the last step. ``fitted`` is "yes", "no", in
    how many of the scenes, "as given", or empty where there is nothing to fit. What holds for
    several lines stands in the notes once: the protocol where it changes, how fast those who
    move are and how many recordings were fitted to once per scene. In the table it stands in
    every line.
    """
    primary, classes = primary_rows(rows), speed_classes(rows)
    count = len(group(primary, "scene"))
    together = group(primary, "predictor").values() if count > 1 else ()
    lines = [_line(some, f"mean of {count}", classes) for some in together]
    apart = group(rows, "predictor", "scene").items()
    lines += [_line(some, str(scene), classes) for (_, scene), some in apart]
    protocol = ""
    for some in group(lines, "scene").values():
        said = {protocol}
        for line in some:
            protocol = line.pop("protocol")
            stated = [protocol, *line.pop("stated")]
            notes = [text for text in stated if text not in said]
            line["notes"] = "; ".join([*notes, *line.pop("remarks")]) or None
            said.update(stated)
    return lines


def primary_rows(rows: list[Row]) -> list[Row]:
    """Lines of the primary scenes; of all where there is none."""
    return [row for row in rows if row["role"] == "primary"] or rows


def stepwise(rows: list[Row], name: str = "all") -> list[Row]:
    """Lines of single steps of a slice."""
    return [row for row in rows if row["step"] != "all" and row["slice"] == name]


def speed_classes(rows: list[Row]) -> dict[str, str]:
    """Return the names of the classes of speed, slowest first, and their bounds in words."""
    bounds = {
        str(row["slice"]): (float(row["from_mps"]), row["below_mps"])
        for row in rows
        if row.get("from_mps") is not None
    }
    slowest_first = sorted(bounds, key=lambda name: bounds[name][0])
    return {name: _bounds(*bounds[name]) for name in slowest_first}


def _bounds(least: float, below: float | None) -> str:
    if below is None:
        return f"from {least:g} m/s on"
    return f"{least:g} to {below:g} m/s" if least else f"below {below:g} m/s"


def _line(rows: list[Row], scene: str, classes: Mapping[str, str]) -> Row:
    """Condense the lines of one predictor, in one or several scenes."""
    whole = [row for row in rows if row["step"] == "all" and row["slice"] == "all"]
    steps = list(group(stepwise(rows), "step").values())
    cover = [known_mean(column(some, "cover_95")) for some in steps]
    bounds = ", ".join(f"{name} {text}" for name, text in classes.items())
    return {
        "predictor": whole[0]["predictor"],
        "scene": scene,
        "windows": int(column(whole, "windows").sum()),
        **{name: rounded(known_mean(column(whole, of))) for name, of in MEANS.items()},
        "cover_95_steps": f"{np.min(cover):.3f} to {np.max(cover):.3f}",
        **{f"cover_95_{name}": _covered(rows, name) for name in classes},
        **{name: rounded(known_mean(column(steps[-1], name))) for name in AREAS},
        "fitted": _fitted(whole),
        "protocol": "; ".join([*_texts(whole, "protocol"), *([bounds] if bounds else [])]),
        "stated": [*_speed_notes(whole), *_of_one(whole, "noise"), *_fits(whole, FITTED)],
        "remarks": [*_fits(whole, UNFITTED), *_of_one(whole, "reasons")],
    }


def _covered(rows: list[Row], name: str) -> float | None:
    """Coverage of a class over all steps, mean of the scenes that have it; None without any."""
    some = [row for row in rows if row["step"] == "all" and row["slice"] == name]
    return rounded(known_mean(column(some, "cover_95"))) if some else None


def _speed_notes(rows: list[Row]) -> list[str]:
    """Say how fast those who move are; of several scenes, where dt is likely to be wrong."""
    notes = []
    for row in rows:
        speed = float(row["speed_mps"])
        asked = doubts(speed)
        notes += [f"{row['scene']}: {text}" for text in asked]
        if not asked and len(rows) == 1 and np.isfinite(speed):
            notes.append(f"median speed {speed:.3g} m/s of those who move")
    return notes


def _of_one(rows: list[Row], name: str) -> list[str]:
    """Return what a column says of a single scene, if anything."""
    return [str(rows[0][name])] if len(rows) == 1 and rows[0][name] else []


def _fitted(rows: list[Row]) -> str | None:
    """Say in a word whether the predictor was fitted."""
    if not any(str(row["fitted"]).startswith((FITTED, UNFITTED)) for row in rows):
        return AS_GIVEN if rows[0]["fitted"] == AS_GIVEN else None
    count = sum(str(row["fitted"]).startswith(FITTED) for row in rows)
    return {0: "no", len(rows): "yes"}.get(count, f"{count} of {len(rows)}")


def _fits(rows: list[Row], begin: str) -> list[str]:
    return [text for text in _texts(rows, "fitted") if text.startswith(begin)]


def _texts(rows: list[Row], name: str) -> list[str]:
    """Return a column's texts, each once, sorted."""
    return sorted({str(row[name]) for row in rows})
