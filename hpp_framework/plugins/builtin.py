"""What the framework itself brings; it registers as any plugin does."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub

Table = tuple[tuple[str, str, str], ...]
"""Names, sources below a package, summaries."""

DEFAULT_ROBOT, DEFAULT_TEAM = "fetch", "fetch,freight"
DEFAULT_SKILL, DEFAULT_TASK, DEFAULT_WORLD = "p2p", "rendezvous", "training"
DEFAULT_PREDICTOR, DEFAULT_BASELINE = "far-sighted", "centralized-mp"
UNDISTURBED = "ideal"
"""What is meant where no name is given: of the bundled plugins, no other module names one as a default."""

WORLDS: Table = (
    ("training", "generators.training:training", "random furniture, another room each seed"),
    ("mixed", "generators.mixed:mixed", "one of all random kinds, easy to hard: what skills are trained in"),
    ("rooms", "generators.rooms:rooms", "a furnished flat with doors, about 12 x 12 m"),
    ("corridors", "generators.corridors:corridors", "corridors with bends, junctions, dead ends and alcoves"),
    ("passages", "generators.passages:passages", "a hall cut by walls with narrow passages"),
    ("legs", "generators.legs:legs", "table and chair legs, 0.6 m or more apart"),
    ("barn", "generators.barn:barn", "dense clutter after the BARN data set, 5 x 5 m"),
    ("walls", "generators.walls:walls", "one to three long thick walls: for tuning planners"),
    ("varied", "generators.varied:varied", "training, mixed or walls: what predictors are trained in"),
    ("crowd", "generators.crowds:crowd", "an open hall where people walk (people=5)"),
    ("corridor-crowd", "generators.crowds:corridor_crowd", "wide corridors where people walk (people=5)"),
    ("maze", "generators.maze:maze", "a maze with many paths (held out: for reports only)"),
    ("u-trap", "generators.held_out:u_trap", "a dead end between the robots (held out: for reports only)"),
    (
        "two-doors",
        "generators.held_out:two_doors",
        "a wall or corridor with two doors (held out: for reports only)",
    ),
    (
        "l-room",
        "generators.held_out:l_room",
        "an L-shaped room, a robot in either leg (held out: for reports only)",
    ),
    ("simple", "catalogue:simple", "an empty room, 20 x 20 m"),
    ("wall", "catalogue:wall", "one wall, 8 m long, between the robots"),
    ("navigation", "catalogue:navigation", "a room full of walls, boxes and pillars"),
    ("real-simple", "catalogue:real_simple", "the scan of a room with furniture along its walls, 12 x 10 m"),
    ("real-wall", "catalogue:real_wall", "the scanned room with a row of cupboards between the robots"),
    (
        "real-forest",
        "catalogue:real_forest",
        "the scanned room full of raised desks, among whose legs robots drive",
    ),
    ("real-roundabout", "catalogue:real_roundabout", "the scanned room with a path around an island"),
)
PLANNERS: Table = (
    ("hpp", "hpp.planner:hpp", "hierarchical predictive planning (presets: paper, best)"),
    ("hpp-options", "options:options", "hpp that chooses a skill as well as a goal"),
    (
        "geodesic-midpoint",
        "baselines.geodesic:geodesic_midpoint",
        "where the last robot arrives soonest (by=speed)",
    ),
    ("centralized-mp", "baselines.centralized:midpoint", "all robots to the midpoint"),
    ("centralized-oa", "baselines.centralized:other", "each robot to another one"),
    ("centralized-rp", "baselines.centralized:random_point", "all robots to one random point"),
    ("rrt-mp", "baselines.rrt_planner:midpoint", "an RRT path to the midpoint (presets: paper, best)"),
    ("rrt-oa", "baselines.rrt_planner:other", "an RRT path to another agent (presets: paper, best)"),
    (
        "rrt-cem",
        "baselines.rrt_cem:cem",
        "CEM over goals, RRT paths as its motion model (presets: paper, best)",
    ),
    ("stubborn", "baselines.scripted:stubborn", "scripted agent that keeps one goal of its own (x, y)"),
    (
        "route",
        "baselines.scripted:route",
        "scripted agent that drives waypoints (points=0 0; 4 0), like a leader",
    ),
    ("wander", "baselines.scripted:wander", "a stranger that drives from place to place in sight"),
    (
        "full-communication",
        "oracles.oracle:full_communication",
        "an oracle: one hpp for all, each robot predicted by itself",
    ),
    (
        "perfect-model",
        "oracles.oracle:perfect_model",
        "an oracle: one hpp for all, and the simulator predicts",
    ),
)
POLICIES: Table = (
    ("maddpg", "baselines.maddpg:maddpg", "learned end to end (Lowe et al. 2017); uses no skill"),
)
LAYERS: Table = (
    (
        "rotate-to-path",
        "rotate_to_path:rotate_to_path",
        "turns a robot round where its path begins behind it",
    ),
    ("terminal-approach", "terminal_approach:terminal_approach", "drives the last metres into a gathering"),
    ("yield-together", "yield_together:yield_together", "slows robots that meet to the speed that is enough"),
    ("stop-on-success", "stop_on_success:stop_on_success", "stops where braking now fulfils the task"),
    ("separation", "separation:separation", "slows a robot down before it could touch a teammate"),
    ("safety-filter", "safety_filter:safety_filter", "keeps a robot off what it sees and has seen"),
    ("watchdog", "watchdog:watchdog", "stops a robot whose lidar cannot be believed"),
)
DEFAULT_CONTROL = (
    "rotate-to-path,terminal-approach,yield-together,stop-on-success,separation,safety-filter,watchdog"
)
"""Control stack of all robots unless an experiment or a team file names another."""
DEFAULT_DISTURBANCES = "field"
"""Profile of disturbances unless an experiment or a team file names another."""
ESTIMATORS: Table = (
    ("none", "raw:raw", "takes what was sensed last for the present"),
    ("dead-reckoning", "dead_reckoning:dead_reckoning", "moves late and lost poses of other robots on"),
    ("tracker", "tracker:tracker", "a Kalman filter a robot, with lidar sightings; foresees its latency"),
)
DEFAULT_ESTIMATOR = "tracker"
"""Estimator of all agents unless an experiment names another."""
PREDICTORS: Table = (
    ("delta-pose-lidar", "delta_pose_lidar", "the paper's one-step model, rolled out (Eq. 2 and 3)"),
    ("pose-lidar", "pose_lidar", "the paper's ablation: next pose and scan, in world coordinates"),
    (
        "delta-general-pose-lidar",
        "delta_general_pose_lidar",
        "the paper's ablation: next pose seen from the agent, and next scan",
    ),
    ("far-sighted", "far_sighted", "positions 1 to 15 s ahead, along paths through what was seen"),
    ("constant-velocity", "constant_velocity", "all robots go on as now; needs no weights"),
    ("empty-world", "empty_world", "each robot's own skill without obstacles; needs no weights"),
)
LEARNED = ("delta-pose-lidar", "pose-lidar", "delta-general-pose-lidar", "far-sighted")
"""Predictors that are trained."""


def register(hub: Hub) -> None:
    """Add the framework's own worlds, planners and predictors."""
    for registry, package, table in (
        (hub.worlds, "worlds", WORLDS),
        (hub.planners, "planning", PLANNERS),
        (hub.policies, "planning", POLICIES),
        (hub.layers, "control", LAYERS),
        (hub.estimators, "perception.estimators", ESTIMATORS),
    ):
        for name, source, summary in table:
            registry.add(name, f"hpp_framework.{package}.{source}", summary=summary)
    for name, module, summary in PREDICTORS:
        hub.predictors.add(name, f"hpp_framework.prediction.{module}:create", summary=summary)
        if name in LEARNED:
            hub.predictor_trainers.add(name, f"hpp_framework.prediction.{module}:train")
