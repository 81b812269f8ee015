"""Episodes of an experiment in which the commands of one robot come from outside."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

from wideberth.experiments.engine.base import Experiment, Row, Task
from wideberth.experiments.engine.closed_loop import controllers_of
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run, recast, watched
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.episode_measures import verdict

Enter: TypeAlias = Callable[[Run, RobotAgent], Controller]
"""Takes an episode that is about to begin and a robot of it; returns who decides in its place."""


def chosen_task(experiment: Experiment, case: Sequence[str], seed: int | None = None) -> Task:
    """Return the first task of an experiment that fits, with a seed of its own or the one given.

    Parameters
    ----------
    case : as in ``scenario=circle``; columns of the table and what stands in them.
    seed : of the episode, also one that the experiment does not play; None for the task's own.

    Raises
    ------
    WideberthError : the experiment drives no robot, or has no such case.
    """
    if not controllers_of(experiment):
        raise WideberthError(
            f"{type(experiment).__name__} drives no robot; take a config that plays episodes, "
            "such as crowdnav or random_crowd"
        )
    tasks = list(experiment.tasks())
    for entry in case:
        column, _, value = entry.partition("=")
        known = list(dict.fromkeys(key for task in tasks for key in task.settings))
        if column not in known:
            raise WideberthError(f"--case {entry}: {unknown('column', column, known)}")
        values = list(dict.fromkeys(str(task.settings[column]) for task in tasks))
        tasks = [task for task in tasks if str(task.settings[column]) == value]
        if not tasks:
            raise WideberthError(f"--case {entry}: {unknown(column, value, values)}")
    return tasks[0] if seed is None else replace(tasks[0], seed=seed)


def play_from_outside(
    experiment: Experiment,
    task: Task,
    enter: Enter,
    look: Callable[[Run], None],
    robot: str = "",
) -> tuple[Row, Episode]:
    """Do a task with another controller for one robot; all else is as `wideberth run` has it.

    The experiment itself plays and judges the episode. Of a task that plays several, the first one
    is driven from outside.

    Parameters
    ----------
    task : of the experiment. enter : returns who decides.
    look : is called after every step of the episode. Either may raise, which ends the task.
    robot : which one; the first by default. All others, people too, decide as in the task.

    Returns
    -------
    row : of the table, with `verdict`. episode : that was played.

    Raises
    ------
    WideberthError : no such robot, one that moves in space; or the experiment asks more of its
        controllers than commands.
    """
    taken: list[Run] = []

    def cast(run: Run, agents: Sequence[RobotAgent]) -> list[RobotAgent]:
        if taken:
            return list(agents)
        taken.append(run)
        return _replaced(run, agents, enter, robot)

    with recast(cast), watched(lambda run: look(run) if run is taken[0] else None):
        rows = experiment.measure(task).rows
    if not taken or not taken[0].ended:
        raise WideberthError(f"{task.name}: no episode is played to its end")
    episode = taken[0].episode()
    return verdict(episode, taken[0].settings.time_limit) | rows[0], episode


def _replaced(run: Run, agents: Sequence[RobotAgent], enter: Enter, name: str) -> list[RobotAgent]:
    """Return the agents, one of them with another controller."""
    robots = {one.name: one for one in agents if not one.person}
    name = name or next(iter(robots))
    if name not in robots:
        raise WideberthError(f"--robot: {unknown('robot', name, robots)}")
    own = robots[name]
    if own.robot.dimension != 2:
        raise WideberthError(f"{name} moves in space; take a robot on the ground")
    controller = enter(run, own)
    phase = own.phase if controller.period == own.controller.period else 0.0
    other = replace(own, controller=controller, phase=phase, truth=False)
    return [other if one is own else one for one in agents]
