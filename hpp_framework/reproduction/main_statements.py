"""The paper's statements about HPP and its baselines (sections 5.1 to 5.3).

HPP is checked twice, as the paper has it (preset ``paper``) and as this project improved it (``best``).
"""

from __future__ import annotations

from hpp_framework.reproduction.claims import Claim
from hpp_framework.reproduction.experiments import (
    BEST,
    CENTRALIZED,
    LEARNED,
    MAPPED,
    PAPER,
    RRT,
    SCANNED,
    SIMULATED,
)
from hpp_framework.reproduction.measures import Measures
from hpp_framework.reproduction.statement import ALIKE, FAILURE, FASTER, SUCCESS, arms, each, statement

CLUTTERED = ("wall", "navigation", "real-wall", "real-forest", "real-roundabout")
EASIER = tuple(world for world in SCANNED if world != "real-forest")

HPP = arms("main", (PAPER, BEST))
MP, OA, RP = arms("main", CENTRALIZED)
RRTS, MAPPED_RRTS = arms("main", RRT), arms("main", MAPPED)
(MADDPG,) = arms("main", (LEARNED,))
PLAIN_RRTS = arms("plain-rrt", RRT)


def centralised_statements(of: Measures) -> list[Claim]:
    """Return what section 5.1 says of HPP and the centralised heuristics."""
    where = "section 5.1, figure 4"
    return [
        statement(
            "HPP brings robots closer together than a random point does.", where,
            "Robots count as closer if the whole interval of the mean difference is below 0:",
            each(of.closer, HPP, [RP], SIMULATED),
        ),
        statement(
            "In the open a random point is the worst of the heuristics.", where, FASTER,
            each(of.better, [MP, OA, *HPP], [RP], ["simple"]),
        ),
        statement(
            "Going to the midpoint does not overcome the wall.", "section 5.1, figures 4 and 7", FAILURE,
            [of.fails(MP, world) for world in ("wall", "real-wall")],
        ),
        statement(
            "HPP chooses better goals at the wall than the midpoint.", where, SUCCESS,
            each(of.more_success, HPP, [MP], ["wall"]),
        ),
        statement(
            "Robots that head for each other end up chasing, unlike those of HPP.", "section 5.1, appendix E",
            "A planner counts as chasing more if the whole interval of the difference is above 0:",
            each(of.chases_more, [OA], HPP, (*SIMULATED, *SCANNED)),
        ),
        statement(
            "Robots that head for each other do not rendezvous.", "section 5.1, appendix E", FAILURE,
            [of.fails(OA, world) for world in (*SIMULATED, *SCANNED)],
        ),
        statement(
            "HPP aligns robots for the rendezvous better than heading for each other.", where, SUCCESS,
            each(of.more_success, HPP, [OA], SIMULATED),
        ),
    ]  # fmt: skip


def rendezvous_time_statements(of: Measures) -> list[Claim]:
    """Return what section 5.2 says of HPP, RRTs and MADDPG."""
    where = "section 5.2, figure 5"
    hard = ("wall", "navigation")
    return [
        statement(
            "In the simple world HPP and the RRT baselines perform similarly.", where, ALIKE,
            each(of.alike, HPP, RRTS, ["simple"]),
        ),
        statement(
            "Beyond the simple world HPP meets sooner than the RRT baselines.", where, FASTER,
            each(of.better, HPP, RRTS, hard),
        ),
        statement(
            "The same against RRTs that know the true map (ours).", where, FASTER,
            each(of.better, HPP, MAPPED_RRTS, hard),
        ),
        statement(
            "None of the three RRT baselines overcomes the wall.", where, FAILURE,
            [of.fails(arm, "wall") for arm in (*RRTS, *MAPPED_RRTS)],
        ),
        statement(
            "Without our tuning, none of the three RRT baselines overcomes the wall.", where, FAILURE,
            [of.fails(arm, "wall") for arm in PLAIN_RRTS], ["plain-rrt"],
        ),
        statement(
            "In the navigation world RRT+CEM does better than the other RRTs.", where, FASTER,
            each(of.better, RRTS[2:], RRTS[:2], ["navigation"]),
        ),
        statement(
            "RRT+CEM does worse than HPP.", where, SUCCESS, each(of.more_success, HPP, RRTS[2:], hard),
        ),
        statement(
            "In the simple world MADDPG meets sooner than HPP.", where, FASTER,
            each(of.better, [MADDPG], HPP, ["simple"]),
        ),
        statement(
            "At the wall MADDPG and HPP perform similarly.", where, ALIKE,
            each(of.alike, [MADDPG], HPP, ["wall"]),
        ),
        statement(
            "In the navigation world MADDPG fails completely.", where,
            "It counts as failing completely if the whole interval of its success is below 0.1:",
            [of.fails(MADDPG, "navigation", 0.1)],
        ),
        statement(
            "In the navigation world MADDPG does worse than HPP.", where, SUCCESS,
            each(of.more_success, HPP, [MADDPG], ["navigation"]),
        ),
    ]  # fmt: skip


def real_room_statements(of: Measures) -> list[Claim]:
    """Return what section 5.3 says of real rooms, and what the abstract says of all."""
    where = "section 5.3, figure 7"
    return [
        statement(
            "HPP generalises to scans of real rooms.", where,
            "A planner counts as completing the task if the whole interval of its success is above 0.5:",
            [of.completes(arm, world) for world in SCANNED for arm in HPP],
        ),
        statement(
            "In the simple real room all planners perform similarly.", where, ALIKE,
            each(of.alike, HPP, [MP, OA, RP, RRTS[1], MADDPG], ["real-simple"]),
        ),
        statement(
            "In the harder real rooms MADDPG does not converge to a meeting.", where, FAILURE,
            [of.fails(MADDPG, world) for world in SCANNED[1:]],
        ),
        statement(
            "Where robots that head for each other chase, HPP completes the task.", where, SUCCESS,
            each(of.more_success, HPP, [OA], SCANNED),
        ),
        statement(
            "HPP struggles in the forest of tables.", where,
            "A world counts as harder if the whole interval of the difference of success is above 0:",
            [of.harder(arm, "real-forest", other) for other in EASIER for arm in HPP],
        ),
        statement(
            "RRT+OA does not meet in time in the real rooms.", "appendix E", FAILURE,
            [of.fails(RRTS[1], world) for world in SCANNED],
        ),
        statement(
            "HPP outperforms all baselines in challenging worlds.", "abstract, sections 5.2 and 6", FASTER,
            each(of.better, HPP, [MP, OA, RP, *RRTS, MADDPG], CLUTTERED),
        ),
    ]  # fmt: skip
