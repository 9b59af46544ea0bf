"""What the dynamic window approach can be told."""

from __future__ import annotations

from hpp_framework.utils.validation import NonNegative, Positive, Several, validated


@validated
class DwaConfig:
    """Sizes and weights of the dynamic window approach.

    The defaults were tuned by random search, 33 trials with ``fetch`` and ``freight-real`` together, in the
    world ``training`` (goals 5 to 10 m away, seeds 5001 and 6001), in ``barn`` (3 to 6 m, seed 6001) and in
    fields of legs 0.75 to 1.3 m apart (5 to 9 m, seeds 5001 and 999), scored by success, success without a
    touch, path length and time. The best few then drove in ``training``, ``legs`` and ``barn`` with seeds 999
    and 6001, where they differed by no more than chance; the one kept is among the two best on average.

    Attributes:
        speeds: forward speeds that are tried, spread over what can be reached in one control period.
        turns: turn rates that are tried with each of them.
        look_ahead: seconds that the robot is imagined to go on with a command.
        margin: gap in metres to obstacles that the robot keeps, beside its footprint.
        blind_turn: angle in radians that the robot may still have to turn while it brakes, unless it turns in
            place: beyond it, it would drive into what its lidar has not seen.
        side_reach: gap in metres beside an arc from which on more makes no difference.
        free_path: metres that a direction must be free for to be headed for instead of the goal, when the
            path to the goal is not; 0 always heads for the goal, as Fox et al. do.
        keep: how much a free direction ahead of the robot is preferred to one nearer to the goal: 0 not at
            all, 1 as much as nearness to the goal.
        goal_radius: distance from the goal in metres within which the robot rests.
        heading: weight of turning towards what it heads for, and not past it.
        progress: weight of coming nearer to it during the look-ahead.
        clearance: weight of the distance to the first hit along the arc.
        side: weight of the gap beside the arc.
        speed: weight of driving fast.
    """

    speeds: Several = 5
    turns: Several = 15
    look_ahead: Positive = 1.06
    margin: NonNegative = 0.043
    blind_turn: NonNegative = 0.66
    side_reach: Positive = 0.175
    free_path: NonNegative = 1.44
    keep: NonNegative = 0.73
    goal_radius: Positive = 0.2
    heading: NonNegative = 0.91
    progress: NonNegative = 0.54
    clearance: NonNegative = 0.26
    side: NonNegative = 0.034
    speed: NonNegative = 0.45
