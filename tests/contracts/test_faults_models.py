"""Predictors and planners, one thing wrong with each: (what is wrong, plugin, rule, words of the message)."""

from __future__ import annotations

import copy
from types import SimpleNamespace

import pytest
import torch

from hpp_framework import testing
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, certain
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.team import Member, Team
from hpp_framework.core.types import Trajectories
from hpp_framework.plugins.registry import hub
from hpp_framework.testing import check_planner, check_predictor
from hpp_framework.utils.errors import CheckpointError

TEAM = Team(
    tuple(
        Member(id=name, robot=hub().robots.create(name), skill="pure-pursuit")
        for name in ("fetch", "freight")
    )
)


def replace(thing, **changes):
    """Return a copy with other members, unchecked: the tests' own checks of types would come first."""
    changed = copy.copy(thing)
    for name, value in changes.items():
        object.__setattr__(changed, name, value)
    return changed


class Straight(Predictor):
    """All robots head straight for the goal at 0.5 m/s."""

    def __init__(self, request=None):
        self.agent = request.agent if request else 0

    def rollout(self, observation, goals, horizon):
        times = 0.2 * torch.arange(1, horizon + 1)
        now = observation.team_poses[:, None, None]
        offset = goals[:, :, None, None] - now[..., :2]
        done = (0.5 * times[:, None] / offset.norm(dim=-1).clamp(min=1e-3)).clamp(max=1.0)
        place = now[..., :2] + done[..., None] * offset
        heading = now[..., 2:].expand(*place.shape[:-1], 1)
        return Trajectories(torch.cat([place, heading], -1), times, torch.full_like(place[..., 0], 0.1))


def model(change):
    """Return a predictor whose answers are changed by a function of (model, observation, goals, answer)."""

    class Changed(Straight):
        steps = 0

        def rollout(self, observation, goals, horizon):
            return change(self, observation, goals, super().rollout(observation, goals, horizon))

    return Changed


def moved(change):
    """Return a predictor whose poses are changed by a function of (goals, poses)."""
    return model(lambda it, seen, goals, out: replace(out, poses=change(goals, out.poses)))


def timed(change):
    return model(lambda it, seen, goals, out: replace(out, times=change(out.times)))


def unsure(change):
    return model(lambda it, seen, goals, out: replace(out, std=change(out.std)))


class Deaf(Straight):
    """Looks five steps ahead, whatever is asked."""

    def rollout(self, observation, goals, horizon):
        return super().rollout(observation, goals, 5)


class Otherwise(Straight):
    """Has a quick method with another result."""

    def condition(self, observation, horizon):
        return lambda goals: self.rollout(observation, goals + 1.0, horizon)


class First(Straight):
    """Knows robot 0 alone."""

    def rollout(self, observation, goals, horizon):
        if observation.agent != 0:
            raise KeyError("self-rover")
        return super().rollout(observation, goals, horizon)


def counts(it, seen, goals, out):
    it.steps += 1
    return replace(out, poses=out.poses + 0.01 * it.steps)


def wipes(it, seen, goals, out):
    seen.scans.zero_()
    return out


def no_weights(request):
    raise CheckpointError("there are no weights 'self-disc.safetensors'")


def ego(it, seen, goals, out):
    return replace(out, poses=out.poses - torch.cat([seen.pose[:, :2], seen.pose.new_zeros(4, 1)], 1)[
        : len(out.poses), None, None, None] + 3.0)  # fmt: skip


def seen_twice(goals, poses):
    return torch.cat([poses[:, :1] * 0.99, poses[:, 1:]], 1)


PREDICTORS = [
    ("no Trajectories", model(lambda it, seen, goals, out: out.poses), "shape",
     "returned Tensor, not Trajectories"),
    ("one robot", moved(lambda goals, poses: poses[:, :, :, :1]), "shape",
     "(4, 5, 3, 1, 3), not (4, 5, 3, 2, 3)"),
    ("double", moved(lambda goals, poses: poses.double()), "dtype", "poses of type torch.float64"),
    ("not a number", moved(lambda goals, poses: poses / 0.0 * 0.0), "not-finite", "240 coordinates"),
    ("five steps always", Deaf, "horizon", "returned 5 times for a horizon of 3"),
    ("times from zero", timed(lambda times: times - 0.2), "times", "has times [0.0, 0.2"),
    ("backwards", timed(lambda times: times.flip(0)), "times", "for 3 steps"),
    ("one time", timed(lambda times: times[:1]), "times", "for 3 steps"),
    ("times in milliseconds", timed(lambda times: times * 1000), "times", "has times [200.0, 400.0"),
    ("in its own frame", model(ego), "jumps", "time 0 is now), at a top speed of 1 m/s"),
    ("at the goal at once", moved(lambda goals, poses: 0 * poses + torch.nn.functional.pad(
        3 * goals, (0, 1))[:, :, None, None]), "jumps", "between time 0 and 1 (0.20 s"),
    ("negative deviation", unsure(lambda std: -std), "std", "from -0.1 m on"),
    ("deviation an axis", unsure(lambda std: std[..., None]), "std", "std of shape (4, 5, 3, 2, 1)"),
    ("first goal otherwise", moved(seen_twice), "goal-order", "goals in another order otherwise"),
    ("two results", Otherwise, "condition", "imagines otherwise than rollout()"),
    ("robot 0 alone", First, "agent", "the predictor of robot 1 raised KeyError: 'self-rover'"),
    ("remembers", model(counts), "not-repeatable", "answers the same question otherwise"),
    ("noise", moved(lambda goals, poses: poses + 0.1 * torch.rand_like(poses)), "global-rng", "of torch"),
    ("wipes the scans", model(wipes), "mutates-input", "changed what it was given"),
    ("mean of the batch", moved(lambda goals, poses: poses + 0.1 * goals.mean()), "batch",
     "episode 0 of a batch"),
    ("no weights", no_weights, "weights", "no weights 'self-disc.safetensors'"),
]  # fmt: skip


class Midpoint(MetaPlanner):
    """All to the middle."""

    def __init__(self, context=None):
        self.bounds = context.bounds if context else None

    def plan(self, observation, belief, rng):
        goal = observation.team_poses[..., :2].mean(1)
        return Decision(goal, certain(goal))


def planner(change=None, **members):
    """Return a planner whose goal is changed by a function of (planner, observation, belief, goal)."""

    class Changed(Midpoint):
        plans = 0

        def plan(self, observation, belief, rng):
            decision = super().plan(observation, belief, rng)
            return change(self, observation, belief, decision.goal) if change else decision

    for name, value in members.items():
        setattr(Changed, name, value)
    return Changed


def forged(goal, belief):
    """Return a decision whose goal is not checked, as it is not outside of tests."""
    decision = Decision(belief.goal, belief)
    object.__setattr__(decision, "goal", goal)
    return decision


def sure(change):
    """Return a planner with another goal, of which it is certain."""

    def plan(it, seen, belief, goal):
        goal = change(it, seen, belief, goal)
        return Decision(goal, certain(goal))

    return planner(plan)


def counting(it, seen, belief, goal):
    it.plans += 1
    return goal + 0.1 * it.plans


def drifts(it, seen, belief, goal):
    if belief is not None:
        belief.goal.add_(0.1)
    return goal


def stale(it, seen, belief, goal):
    return seen.poses[:, 0, 0, :2]


def fails_alone(self, observation, decision):
    # episodes are run two by two
    if len(decision.goal) == 2:
        raise ZeroDivisionError("no path left")
    return decision


class Everywhere:
    """What all planners of a process share."""

    episodes = 0


def learns(context):
    Everywhere.episodes += context.agent
    return sure(lambda it, seen, belief, goal, n=Everywhere.episodes: goal + 0.3 * n)(context)


FIRST = SimpleNamespace(made={})


def one_for_two(context):
    FIRST.made["all"] = FIRST.made.get("all") or Midpoint(context)
    return FIRST.made["all"]


PLANNERS = [
    ("never again", planner(plan_every=0), "plan-every", "plan_every is 0"),
    ("every two and a half", planner(plan_every=2.5), "plan-every", "plan_every is 2.5"),
    ("perhaps shared", planner(shared_rng="no"), "shared-rng", "'no', not True or False"),
    ("goal alone", planner(lambda it, seen, belief, goal: goal), "belief",
     "returned Tensor, not a Decision"),
    ("as before", planner(lambda it, seen, belief, goal: (goal, certain(goal))), "belief",
     "returned tuple, not a Decision"),
    ("negative std", planner(lambda it, seen, belief, goal: Decision(
     goal, Belief(goal, goal, goal * 0 - 0.5))), "belief", "a negative std, -0.5"),
    ("one std", planner(lambda it, seen, belief, goal: Decision(
     goal, replace(certain(goal), std=goal[:, 0]))), "belief", "whose std is (4,)"),
    ("a goal a robot", planner(lambda it, seen, belief, goal: forged(
     goal[:, None] + seen.team_poses[..., :2], certain(goal))), "shape", "shape (4, 2, 2), not (4, 2)"),
    ("double", sure(lambda it, seen, belief, goal: goal.double()), "dtype", "torch.float64"),
    ("not a number", sure(lambda it, seen, belief, goal: goal / 0.0 - goal / 0.0), "not-finite", "8 of 8"),
    ("millimetres", sure(lambda it, seen, belief, goal: 1000 * seen.pose[:, :2].clone()), "goal-outside",
     "bounds are (-"),
    ("a view of the history", sure(stale), "shares-memory", "lies in an input's memory"),
    ("changes its belief", sure(drifts), "mutates-input", "plan() with a belief changed"),
    ("counts its plans", sure(counting), "not-repeatable", "plan() answers the same question otherwise"),
    ("torch's generator", sure(lambda it, seen, belief, goal: goal + 0.1 * torch.randn_like(goal)),
     "global-rng", "generator of torch"),

        ("mean of the batch", sure(lambda it, seen, belief, goal: 0 * goal + goal.mean(0)), "batch",
     "otherwise than the same episode alone"),
    ("fails on the way", planner(follow=fails_alone), "raises", "in an episode of 12 control steps"),
    ("learns from episode to episode", learns, "not-repeatable",
     "an episode with the same seed and new agents"),
    ("one for two robots", one_for_two, "shared-object", "the same object"),
    ("another signature", lambda team, agent: Midpoint(), "signature",
     "(context: PlannerContext) -> MetaPlanner"),
    ("no weights", no_weights, "weights", "finds no weights"),
    ("a missing key", lambda context: {}["goal"], "build", "KeyError: 'goal'"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("wrong", "plugin", "rule", "words"), PREDICTORS, ids=[case[0] for case in PREDICTORS]
)
def test_broken_predictors_are_caught(wrong, plugin, rule, words, caught):
    caught(check_predictor, plugin, rule, words, team=TEAM)


@pytest.mark.parametrize(("wrong", "plugin", "rule", "words"), PLANNERS, ids=[case[0] for case in PLANNERS])
def test_broken_planners_are_caught(wrong, plugin, rule, words, caught):
    caught(check_planner, plugin, rule, words, team=TEAM)


def test_the_unbroken_predictor_is_fine():
    check_predictor(Straight, team=TEAM)
    check_predictor(Straight(), team=TEAM)


def test_the_unbroken_planner_is_fine():
    check_planner(Midpoint, team=TEAM)
    check_planner(Midpoint(), team=TEAM)


def test_every_rule_has_a_fault(rules_of):
    assert rules_of(testing.predictor, testing.planner) <= {rule for _, _, rule, _ in PREDICTORS + PLANNERS}
