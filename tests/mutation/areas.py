"""Which modules are changed, which tests are tried, and which of them reach a change."""

import ast
import random
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from wideberth.tests.mutation.sites import Site, sites

Found = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]
MPC, CORE = "framework/mpc", "predictors/core"
AREAS: dict[str, list[str]] = {
    "cycle": [
        "framework/tracking/perception.py",
        "framework/values/path_progress.py",
        f"{MPC}/ocp/reference.py",
        "controllers/costs/curve.py",
        "controllers/recommended.py", "controllers/judging/*.py",
        *(
            f"{MPC}/planner/{name}.py"
            for name in (
                "cycle", "emergency", "instance", "judge", "multistart", "planner", "rollout",
                "settings", "starts", "stopping", "watchdog",
            )
        ),
    ],
    "ladder": [
        f"{MPC}/planner/giving_way.py", f"{MPC}/planner/rungs.py", f"{MPC}/planner/verify.py",
        "controllers/diagnosis/explain.py",
    ],
    "filling": [
        *(f"{MPC}/slots/{name}.py" for name in ("base", "gaussian_discs", "static_polygons")),
        f"{MPC}/planner/own_uncertainty.py",
        *(f"{MPC}/ocp/{name}.py" for name in ("bodies", "problem", "stage", "transcription")),
        f"{MPC}/assembly.py",
        *(
            f"{MPC}/levels/{name}.py"
            for name in ("base", "relaxed")
        ),
        "controllers/levels/*.py",
    ],
    "regions": [
        "regions/*.py", "regions/static/*.py", "framework/numerics/geometry.py",
        "metrics/ellipses.py",
    ],
    "propagation": [
        "framework/values/forecast.py",
        *(
            f"{CORE}/{name}.py"
            for name in (
                "kalman_filter", "propagation", "small_matrices", "velocity_forecast",
                "velocity_process",
            )
        ),
        "predictors/coordinated_turn.py", "predictors/interacting_models.py", "predictors/var.py",
    ],
    "calibration": [
        f"{CORE}/calibration.py", f"{CORE}/error_shape.py", "framework/calibration.py",
        "predictors/calibrations/*.py", "predictors/conformal.py",
        "predictors/adaptive_conformal.py", "predictors/empirical.py",
        "predictors/data/windows.py",
    ],
    "judging": ["simulation/measures/*.py", "simulation/log/episode_log.py"],
    "metrics": [
        *(f"metrics/{name}.py" for name in ("comfort", "episode", "motion", "plan")),
        "metrics/scoring.py", "metrics/statistics.py",
        "framework/numerics/eigenframe.py", "framework/risk/collision_probability.py",
    ],
    "slots": [f"controllers/slots/{name}.py" for name in ("drawn_futures", "between_steps")],
    "routes": ["routes/around_crowds.py", "routes/rerouting.py"],
    "identities": ["framework/tracking/identities.py"],
    "tables": ["experiments/engine/extract.py"],
}  # fmt: skip
TESTS = (
    "alignment",
    "avoidable",
    "cycle.py",
    "bounded_numbers",
    "choice_by_cost",
    "values_are_drawn",
    "level_risk",
    "regions_in_planner",
    "number_limits",
    "numbers_of_settings",
    "multistart",
    "withdrawing",
    "kept_in_step",
    "judged_in_time",
    "ladder",
    "rungs",
    "levels",
    "measures",
    "metrics",
    "no_covariance",
    "perception_log",
    "own_uncertainty",
    "scoring",
    "starts",
    "reachability",
    "warm_start",
    "statistics",
    "windows",
    "first_contact",
    "expected_contact",
    "manoeuvres",
    "judged_plans",
    "gaps",
    "explain",
    "slot_kinds",
    "contouring",
    "costs",
    "crowdnav_verdict",
    "problem",
    "propagation",
    "recommended",
    "walls.py",
    "planner_failures",
    "planner_observations",
    "planner_paths",
    "planner_plans",
    "predictors.py",
    "calibrations",
    "functional_constant",
    "predictors_adaptive",
    "predictors_conformal",
    "predictors_degenerate",
    "predictors_empirical",
    "predictors_fit_laws",
    "predictors_history",
    "predictors_imm",
    "predictors_kalman",
    "predictors_reacting",
    "predictors_smoothed",
    "predictors_turn",
    "predictors_var",
    "regions_bad_input",
    "regions_centre",
    "regions_contract",
    "regions_geometry",
    "regions_inflation",
    "regions_interface",
    "regions_inversion",
    "regions_laws",
    "regions_level",
    "regions_outer",
    "regions_polygonal",
    "regions_projection",
    "regions_rectangles",
    "regions_relations",
    "regions_space",
    "regions_tails",
    "golden_regions",
    "static_regions",
    "risk",
    "three_dimensions",
    "giving_way",
    "watch",
    "late_commands",
    "simulation_",
    "footprints",
    "terminal",
    "deadline",
    "values",
    "rate_limited_warnings",
    "summary",
    "drawn_",
    "between_steps",
    "around_crowds",
    "rerouting",
    "identities",
    "printed_tables",
    "extracted_tables",
)
"""Parts of the names of the test files that are tried; others test other modules, play whole
episodes, draw, or start processes."""


def paths(area: str) -> list[str]:
    """Modules of an area."""
    found = [str(one.relative_to(ROOT)) for name in AREAS[area] for one in sorted(ROOT.glob(name))]
    return [one for one in found if not one.endswith("__init__.py")]


def draw(
    modules: dict[str, str], seed: int, count: int, areas: Sequence[str] = tuple(AREAS)
) -> list[tuple[str, Site]]:
    """Draw changes, as many from each of some areas, one area after the other in turn."""
    rng = random.Random(seed)
    columns = []
    for number, area in enumerate(areas):
        every = [site for path in paths(area) for site in sites(path, modules[path])]
        share = count // len(areas) + (number < count % len(areas))
        columns.append([(area, one) for one in rng.sample(every, min(share, len(every)))])
    return [one for row in zip_longest(*columns) for one in row if one is not None]


def reaching(site: Site, source: str, reached: dict[str, Found]) -> list[str]:
    """Tests that call the changed function, the quick and specific ones first.

    Of what stands outside of functions: tests that call a function of the module that names it;
    if there is none, tests that call any function of the class or module.
    """
    asked = {f"{site.path} {site.owner}"}
    if site.names:
        asked = {f"{site.path} {name}" for name in _naming(ast.parse(source), site.names)}
    fitting = [test for test, found in reached.items() if asked & {*found["functions"]}]
    if not fitting and site.names:
        around = f"{site.path} {site.owner}"
        fitting = [
            test
            for test, found in reached.items()
            if any(one.startswith(around) for one in found["functions"])
        ]

    def dear(test: str) -> float:
        return float((0.05 + reached[test]["seconds"]) * (5 + len(reached[test]["functions"])))

    return sorted(fitting, key=dear)


def _naming(node: ast.AST, names: tuple[str, ...], owner: str = "") -> Iterator[str]:
    """Qualified names of the functions that name one of these."""
    for child in ast.iter_child_nodes(node):
        name = f"{owner}.{getattr(child, 'name', '')}".strip(".")
        if isinstance(child, ast.ClassDef):
            yield from _naming(child, names, name)
        elif isinstance(child, ast.FunctionDef):
            inside = (getattr(one, "id", getattr(one, "attr", "")) for one in ast.walk(child))
            if any(one in names for one in inside):
                yield name
