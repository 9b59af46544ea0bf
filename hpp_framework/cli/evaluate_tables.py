"""What `hpp evaluate` prints of planners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

Row = dict[str, Any]


def summary_table(cells: Sequence[Row]) -> Table:
    """Return the cells of a summary as a table."""
    table = _table("world", "planner", right=_CELLS)
    for row in cells:
        table.add_row(
            escape(row["world"]), escape(row["planner"]), f"{row['success']:.2f}",
            f"{row['success_low']:.2f} .. {row['success_high']:.2f}", f"{row['first_contact']:.2f}",
            _number(row["time_median_s"], 1), _number(row["time_over_bound_median"], 2),
            _number(row["rpl"], 2), _number(row["price_median"], 2, sign=True),
            f"{row['collision_episodes']}/{row['episodes']}", _number(row["final_distance_mean_m"], 2),
            _number(row["plan_ms_median"], 1),
        )  # fmt: skip
    return table


_CELLS = (
    "success", "95 % interval", "contact", "time s", "x bound", "RPL", "price", "collided", "distance m", "ms"
)  # fmt: skip


def aggregate_table(aggregates: Sequence[Row]) -> Table:
    """Return how planners fare over all worlds."""
    table = _table("world", "planner", right=("RPL IQM", "95 %", "RPL gap", "95 %"))
    for row in aggregates:
        table.add_row(
            escape(row["world"]), escape(row["planner"]),
            *_estimate(row["rpl_iqm"]), *_estimate(row["optimality_gap"]),
        )  # fmt: skip
    return table


def comparison_table(comparisons: Sequence[Row]) -> Table:
    """Return how the first planner compares with each other one."""
    first = comparisons[0]["planner"]
    right = ("success", "95 %", "p", "better", "95 %", "time", "p")
    table = _table("world", f"{first} against", right=right)
    for row in comparisons:
        table.add_row(
            escape(row["world"]), escape(row["against"]),
            *_estimate(row["success_difference"], sign=True), _p_value(row["success_p"]),
            *_estimate(row["improvement"]), _number(row["time_ratio_median"], 2), _p_value(row["time_p"]),
        )  # fmt: skip
    return table


def blame_table(blame: Sequence[Row]) -> Table:
    """Return where success was lost."""
    parts = ("silence", "predictor", "skill")
    table = _table("world", right=("success", *[title for part in parts for title in (part, "95 %")]))
    for row in blame:
        lost = [text for part in parts for text in _estimate(row[part], sign=part != "skill")]
        table.add_row(escape(row["world"]), f"{row['success']:.2f}", *lost)
    return table


def _table(*left: str, right: Sequence[str]) -> Table:
    table = Table(box=None)
    for column in left:
        table.add_column(escape(column), overflow="fold")
    for column in right:
        table.add_column(column, justify="right")
    return table


def _number(value: float | None, digits: int, *, sign: bool = False) -> str:
    return "-" if value is None else f"{value:{'+' if sign else ''}.{digits}f}"


def _p_value(value: float | None) -> str:
    return "<0.001" if value is not None and value < 0.001 else _number(value, 3)


def _estimate(estimate: Sequence[float] | None, *, sign: bool = False) -> tuple[str, str]:
    if estimate is None:
        return "-", "-"
    value, low, high = (_number(each, 2, sign=sign) for each in estimate)
    return value, f"{low} .. {high}"
