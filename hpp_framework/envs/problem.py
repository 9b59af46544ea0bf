"""The point-to-point navigation problem: what counts as arriving, rewards, and domain randomisation."""

from __future__ import annotations

from dataclasses import dataclass, field

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.utils.validation import Share, validated


@dataclass(frozen=True, kw_only=True)
class PointToPoint:
    """The navigation problem: what counts as arriving, and what is rewarded.

    Attributes:
        goal_distance: nearest and farthest goal, straight line, in metres.
        goal_radius: distance at which a goal is reached, in metres.
        rest_speed: forward speed below which the robot is at rest, m/s.
        dwell: consecutive steps at rest at the goal that end an episode with success.
        max_steps: control steps before an episode is truncated (150 are 30 s).
        progress: reward for each metre of progress, straight or along the path if the pool knows paths.
        arrival: reward for success.
        collision: reward for touching something after not touching anything.
        touch: reward for each step in contact.
        step: reward for each step.
        turn: reward for each rad/s of turn rate and step.
        linger: reward for each step at rest at the goal.
    """

    goal_distance: tuple[float, float] = (1.0, 10.0)
    goal_radius: float = 0.3
    rest_speed: float = 0.15
    dwell: int = 5
    max_steps: int = 150
    progress: float = 1.0
    arrival: float = 3.0
    collision: float = 0.0
    touch: float = -0.4
    step: float = -0.02
    turn: float = -0.005
    linger: float = 0.3


@validated
class DomainRandomisation:
    """How training is harder than the plain problem, drawn anew with each world.

    Observations get an entry ``privileged`` for a critic, which no skill sees: metres to go along the path in
    tens, cosine and sine of the path's bearing, the share of time left, and the strength of the disturbances.

    Attributes:
        disturbances: the strongest; a world has a share of them between 0 and 1.
        late: share of worlds in which commands take effect one control period late.
        weakest_drive: smallest share of the top speeds and accelerations that a robot has.
        end_on_touch: share of touches that end an episode as a failure.
        detours: share of tasks that lead to the goal with the longest detour among some.
    """

    disturbances: Disturbances = field(
        default_factory=lambda: Disturbances(
            position_std=0.06, heading_std=0.06, scan_std=0.03, lost_beams=0.08
        )
    )
    late: Share = 0.1
    weakest_drive: Share = 0.8
    end_on_touch: Share = 0.5
    detours: Share = 0.0
