"""Constants of the planning cycle and of the solver, for a planner in another language."""

from ...framework.control import command_limits, end_of_path
from ...framework.mpc.ocp.bodies import MOST_LOOKS
from ...framework.mpc.planner import in_contact, stopping
from ...framework.mpc.planner.multistart import DEEP, STUCK
from ...framework.mpc.planner.rungs import SWITCHING_MARGIN
from ...framework.mpc.planner.starts import WARM_WITHIN
from ...framework.mpc.planner.watchdog import SAME
from ...framework.mpc.slots.base import FAR, WIDE
from ...framework.mpc.slots.reachability import SURPLUS
from ...framework.mpc.slots.static_polygons import CORNERS
from ...framework.mpc.solver import NO_FORCE
from ...framework.tracking import history, identities, names, noise, stand_ins
from ...framework.tracking.perception import FORGET
from ...framework.values import number_limits, path, path_progress, polygon, tracks
from ...framework.values.arrays import FARTHEST
from ...framework.values.plan import TOLERANCE
from ..riccati.interior_point import BARRIER_TEST, WARM_DISTANCE
from ..riccati.solver import PATIENT_ITERATIONS, PATIENT_PER_STEP, PATIENT_SHARE
from ..riccati.workspace import MOST_PLANS


def planner_constants() -> dict[str, float]:
    """Return the constants of the planning cycle and of the solver `riccati` by name.

    They are no settings: a planner in another language that is to command the same has the same.
    Each is explained where it is defined; units are SI.
    """
    return {
        "CORNERS": CORNERS[0], "FOREVER": command_limits.FOREVER, "FORGET": FORGET,
        "MOST": history.MOST,
        "TOLERANCE": TOLERANCE, "END_LEFT": end_of_path.LEFT, "END_NEAR": end_of_path.NEAR,
        "END_SHARE": end_of_path.SHARE, "END_SHIFT": end_of_path.SHIFT,
        "END_STEP": end_of_path.STEP, "MOST_PLANS": MOST_PLANS, "STUCK": STUCK, "DEEP": DEEP,
        "NO_FORCE": NO_FORCE, "SWITCHING_MARGIN": SWITCHING_MARGIN, "SAME_PLAN": SAME,
        "WARM_WITHIN": WARM_WITHIN, "PATIENT_ITERATIONS": PATIENT_ITERATIONS,
        "PATIENT_PER_STEP": PATIENT_PER_STEP, "PATIENT_SHARE": PATIENT_SHARE,
        "WARM_DISTANCE": WARM_DISTANCE, "WARM_TEST": BARRIER_TEST,
        "FAST": stopping.FAST, "BEYOND": command_limits.FAST,
        "ALLOWANCE": command_limits.ALLOWANCE, "EARLY": path_progress.EARLY,
        "GROWN": path_progress.GROWN, "LONGER": path_progress.LONGER,
        "LONGEST": path_progress.LONGEST, "CUT": path_progress.CUT,
        "PATIENCE": path_progress.PATIENCE, "SAME_PATH": path.SAME,
        "OPPOSITE": path.OPPOSITE, "BESIDE": path.BESIDE, "SURPLUS": SURPLUS,
        "FAR": FAR, "WIDE": WIDE, "FARTHEST": FARTHEST, "SAME_TIME": tracks.ON_GRID,
        "OLDEST": stand_ins.OLDEST, "UNKNOWN_RADIUS": stand_ins.RADIUS,
        "USUAL_NOISE": noise.USUAL, "DENSEST": history.DENSEST,
        "VAGUEST": number_limits.VAGUEST, "LEAP": names.LEAP,
        "UNNAMED_DEVIATION": names.DEVIATION, "CHANGE": identities.CHANGE,
        "LONGEST_GAP": identities.LONGEST, "REMEMBERED": identities.MEMORY,
        "LEAVING": in_contact.LEAVING, "ONWARD": in_contact.AHEAD,
        "SLOWLY": in_contact.SLOWLY, "TOUCHING": in_contact.TOUCHING,
        "OF_SOLVERS": in_contact.ROUNDING, "MOST_LOOKS": MOST_LOOKS,
        "THIN": polygon.THIN, "FLAT": polygon.FLAT,
    }  # fmt: skip
