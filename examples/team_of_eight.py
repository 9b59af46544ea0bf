"""Eight robots meet, with the motion models of a pair: one set of predictors serves any team size.

python examples/team_of_eight.py --episodes 10
hpp run --team fetch,fetch,fetch,fetch,freight,freight,freight,freight --world simple    # the film of one
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from hpp_framework.evaluation.experiment import Experiment, run_experiment


def main() -> None:
    """Evaluate a team and say how it did, and how long planning and simulating took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robots", type=int, default=8, help="half of them Fetch, half Freight")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--world", default="simple")
    parser.add_argument("--planner", default="hpp")
    parser.add_argument("--seed", type=int, default=5001)
    parser.add_argument("--out", type=Path, default=Path("out/team-of-eight"))
    given = parser.parse_args()

    team = ",".join(["fetch", "freight"][index % 2] for index in range(given.robots))
    experiment = Experiment(
        worlds=(given.world,), planners=(given.planner,), team=team, episodes=given.episodes, seed=given.seed
    )
    begun = perf_counter()
    (cell,) = run_experiment(experiment, given.out)["cells"]
    seconds = perf_counter() - begun
    print(
        f"{given.robots} robots in {given.world}: {cell['success']:.2f} of {cell['episodes']} episodes meet; "
        f"{seconds:.0f} s in all"
    )


if __name__ == "__main__":
    main()
