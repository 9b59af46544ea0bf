"""Teams of robots that coordinate without communication, by hierarchical predictive planning.

A *team* of *robots* in a *world* pursues a *task*. Each robot's *agent* runs a *meta-planner* that asks its
*predictors* "where would we all be if we shared this goal?", scores the answer with the *task reward*, keeps
a *belief* over goals, and hands the best goal to a *skill*, which drives the robot.

Each noun is a module or a folder here, and what can be chosen by name is in
:mod:`hpp_framework.plugins.registry`.
"""

from importlib.metadata import version

__version__ = version("hpp-framework")
