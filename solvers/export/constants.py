"""Constants of the planning cycle and of the solver, for a planner in another language."""

from ...framework.control import end_of_path
from ...framework.control.command_limits import FOREVER
from ...framework.mpc.planner.multistart import DEEP, STUCK
from ...framework.mpc.planner.rungs import SWITCHING_MARGIN
from ...framework.mpc.planner.starts import WARM_WITHIN
from ...framework.mpc.planner.watchdog import SAME
from ...framework.mpc.slots.static_polygons import CORNERS
from ...framework.mpc.solver import NO_FORCE
from ...framework.tracking.history import MOST
from ...framework.tracking.perception import FORGET
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
        "CORNERS": CORNERS[0], "FOREVER": FOREVER, "FORGET": FORGET, "MOST": MOST,
        "TOLERANCE": TOLERANCE, "END_LEFT": end_of_path.LEFT, "END_NEAR": end_of_path.NEAR,
        "END_SHARE": end_of_path.SHARE, "END_SHIFT": end_of_path.SHIFT,
        "END_STEP": end_of_path.STEP, "MOST_PLANS": MOST_PLANS, "STUCK": STUCK, "DEEP": DEEP,
        "NO_FORCE": NO_FORCE, "SWITCHING_MARGIN": SWITCHING_MARGIN, "SAME_PLAN": SAME,
        "WARM_WITHIN": WARM_WITHIN, "PATIENT_ITERATIONS": PATIENT_ITERATIONS,
        "PATIENT_PER_STEP": PATIENT_PER_STEP, "PATIENT_SHARE": PATIENT_SHARE,
        "WARM_DISTANCE": WARM_DISTANCE, "WARM_TEST": BARRIER_TEST,
    }  # fmt: skip
