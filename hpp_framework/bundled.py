"""Registers what the framework itself brings: worlds, planners, predictors, by the door plugins use."""

from __future__ import annotations

from hpp_framework.registry import Hub


def register(hub: Hub) -> None:
    """Add the framework's own worlds, planners and predictors."""
    worlds = "hpp_framework.worlds"
    hub.worlds.add(
        "training", f"{worlds}.generators:training", summary="random furniture, another room each seed"
    )
    for name, summary in (
        ("mixed", "one of all random kinds, easy to hard: what skills are trained in"),
        ("rooms", "a furnished flat with doors, about 12 x 12 m"),
        ("corridors", "corridors with bends, junctions, dead ends and alcoves"),
        ("passages", "a hall cut by walls with narrow passages"),
        ("legs", "table and chair legs, 0.6 m or more apart"),
        ("barn", "dense clutter after the BARN data set, 5 x 5 m"),
        ("walls", "one to three long thick walls: for tuning planners"),
        ("maze", "a maze with many ways (held out: for reports only)"),
    ):
        hub.worlds.add(name, f"{worlds}.{name}:{name}", summary=summary)
    for name, summary in (
        ("u-trap", "a dead end between the robots (held out: for reports only)"),
        ("two-doors", "a wall or corridor with two doors (held out: for reports only)"),
        ("l-room", "an L-shaped room, a robot in either leg (held out: for reports only)"),
    ):
        hub.worlds.add(name, f"{worlds}.held_out:{name.replace('-', '_')}", summary=summary)
    hub.worlds.add(
        "varied",
        f"{worlds}.varied:varied",
        summary="training, mixed or walls: what predictors are trained in",
    )
    hub.worlds.add("simple", f"{worlds}.catalogue:simple", summary="an empty room, 20 x 20 m")
    hub.worlds.add("wall", f"{worlds}.catalogue:wall", summary="one wall, 8 m long, between the robots")
    hub.worlds.add(
        "navigation", f"{worlds}.catalogue:navigation", summary="a room full of walls, boxes and pillars"
    )
    for name, summary in (
        ("real-simple", "the scan of a room with furniture along its walls, 12 x 10 m"),
        ("real-wall", "the scanned room with a row of cupboards between the robots"),
        ("real-forest", "the scanned room full of raised desks, among whose legs robots drive"),
        ("real-roundabout", "the scanned room with a way around an island"),
    ):
        hub.worlds.add(name, f"{worlds}.catalogue:{name.replace('-', '_')}", summary=summary)
    planning = "hpp_framework.planning"
    hub.planners.add(
        "hpp", f"{planning}.hpp:hpp", summary="hierarchical predictive planning (presets: paper, best)"
    )
    hub.planners.add(
        "hpp-options", f"{planning}.options:options", summary="hpp that chooses a skill as well as a goal"
    )
    hub.planners.add("centralized-mp", f"{planning}.heuristics:midpoint", summary="everybody to the midpoint")
    hub.planners.add("centralized-oa", f"{planning}.heuristics:other", summary="everybody to another agent")
    hub.planners.add(
        "centralized-rp", f"{planning}.heuristics:random_point", summary="everybody to one random point"
    )
    for name, source, summary in (
        ("rrt-mp", "rrt_planner:midpoint", "an RRT path to the midpoint (presets: paper, best)"),
        ("rrt-oa", "rrt_planner:other", "an RRT path to another agent (presets: paper, best)"),
        ("rrt-cem", "rrt_cem:cem", "CEM over goals, RRT paths as its motion model (presets: paper, best)"),
    ):
        hub.planners.add(name, f"{planning}.{source}", summary=summary)
    hub.planners.add(
        "maddpg", f"{planning}.maddpg:maddpg", summary="learned end to end (Lowe et al. 2017); uses no skill"
    )
    for name, summary in (
        ("stubborn", "a partner that insists on one goal of its own (x, y)"),
        ("route", "a partner that drives way-points (points=0 0; 4 0), like a leader"),
        ("wander", "a stranger that drives from place to place in sight"),
    ):
        hub.planners.add(name, f"{planning}.partners:{name}", summary=summary)
    for name, summary in (
        ("full-communication", "a ceiling: one hpp for all, each robot predicted by itself"),
        ("perfect-model", "a ceiling: one hpp for all, and the simulator predicts"),
    ):
        hub.planners.add(name, f"{planning}.ceilings:{name.replace('-', '_')}", summary=summary)
    prediction = "hpp_framework.prediction"
    for name, module, summary in (
        ("delta-pose-lidar", "delta_pose_lidar", "the paper's one-step model, rolled out (Eq. 2 and 3)"),
        ("pose-lidar", "pose_lidar", "the paper's ablation: next pose and scan, in world coordinates"),
        (
            "delta-general-pose-lidar",
            "delta_general_pose_lidar",
            "the paper's ablation: next pose seen from the agent, and next scan",
        ),
        ("far-sighted", "far_sighted", "positions 1 to 15 s ahead, along ways through what was seen"),
        ("constant-velocity", "constant_velocity", "everybody goes on as now; needs no weights"),
        ("empty-world", "empty_world", "everybody's own skill with nothing in the way; needs no weights"),
    ):
        hub.predictors.add(name, f"{prediction}.{module}:create", summary=summary)
    for name, module in (
        ("delta-pose-lidar", "delta_pose_lidar"),
        ("pose-lidar", "pose_lidar"),
        ("delta-general-pose-lidar", "delta_general_pose_lidar"),
        ("far-sighted", "far_sighted"),
    ):
        hub.predictor_trainers.add(name, f"{prediction}.{module}:train")
