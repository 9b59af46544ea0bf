"""Builds the control loops of a team that an experiment describes."""

from __future__ import annotations

from hpp_framework.agents.build import build_scheduled_agents
from hpp_framework.config.deployment import gate_of, topics_of
from hpp_framework.core.agent import Agent
from hpp_framework.core.estimator import Estimator
from hpp_framework.core.schedule import Schedule
from hpp_framework.core.team import Team, robot_index
from hpp_framework.deploy.assembly import Assembly
from hpp_framework.deploy.loop import RobotLoop
from hpp_framework.deploy.port import RobotPort
from hpp_framework.deploy.safety import Gate
from hpp_framework.evaluation.experiment import Experiment

Bounds = tuple[float, float, float, float]


class LoopBuilder:
    """Knows what the robots of a team run.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        bounds: of the world, metres.
    """

    def __init__(self, experiment: Experiment, planner: str, bounds: Bounds) -> None:
        self.experiment = experiment
        self.team: Team = experiment.make_team()
        self.schedule: Schedule = experiment.make_schedule(self.team)
        config = experiment.agent_config(planner)
        self.agents: list[Agent] = build_scheduled_agents(self.team, self.schedule, config, bounds)
        self.estimators: list[Estimator] = experiment.make_estimators(self.team)

    def index(self, robot: str) -> int:
        """Return the place of a robot in its team.

        Raises:
            ConfigError: if there is no such robot.
        """
        return robot_index(robot, self.team.ids, "--me")

    def loop(self, me: int, port: RobotPort) -> RobotLoop:
        """Return the control loop of one robot.

        Args:
            me: its index.
            port: of the robot.
        """
        name, members = self.team.ids[me], self.experiment.members
        assembly = Assembly(self.team, me, self.estimators[me], topics_of(members, name))
        own = self.experiment.team_disturbances(self.team)[me]
        reaction = own.latency + own.sensing_jitter + own.command_jitter
        gate = Gate(self.team.robots[me], name, self.team.ids, gate_of(members, name), reaction)
        return RobotLoop(self.agents[me], assembly, gate, port)
