"""Prints figures of the code's structure: sizes, depth and cycles of imports, flags that should not be.

python scripts/structure.py
"""

from __future__ import annotations

import ast
import statistics
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1] / "hpp_framework"
FLAGS = ("guided", "heedless", "rests", "centralised", "centralized")
OWNERS = ("planner", "agent")


def main() -> None:
    """Print the figures."""
    trees = {_name(file): ast.parse(file.read_text()) for file in _files()}
    edges = {name: _imports(tree, trees) - {name} for name, tree in trees.items()}
    lengths = sorted(
        node.end_lineno - node.lineno + 1
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.end_lineno
    )
    lines = sum(len(file.read_text().splitlines()) for file in _files())
    roots = [file.name for file in ROOT.glob("*.py") if file.name != "__init__.py"]
    print(f"modules              {len(trees)}")
    print(f"lines                {lines}")
    print(
        f"function lines       median {statistics.median(lengths):g}, p90 {lengths[len(lengths) * 9 // 10]}"
    )
    print(f"modules in the root  {len(roots)}")
    print(f"import depth         {_depth(edges)}")
    print(f"modules in cycles    {len(_cyclic(edges))}")
    print(f"planner flags        {_count(trees, _is_flag)}")
    print(f"isinstance on planners and agents  {_count(trees, _is_type_test)}")


def _files() -> list[Path]:
    return [file for file in sorted(ROOT.rglob("*.py")) if "templates" not in file.parts]


def _name(file: Path) -> str:
    parts = file.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(tree: ast.AST, known: dict[str, ast.Module]) -> set[str]:
    """Return the modules that one imports when it is loaded."""
    found: set[str] = set()
    for node in _at_load(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name for name in inner if name in known} or {node.module}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name in known and known[name].body}


def _at_load(tree: ast.AST) -> list[ast.AST]:
    """Return the nodes outside functions and outside what type checkers alone read."""
    found: list[ast.AST] = []
    left = list(ast.iter_child_nodes(tree))
    while left:
        node = left.pop()
        if isinstance(node, ast.FunctionDef) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        ):
            continue
        found.append(node)
        left += ast.iter_child_nodes(node)
    return found


def _cyclic(edges: dict[str, set[str]]) -> set[str]:
    """Return the modules that import themselves through others."""
    return {name for name in edges if name in _reached(edges, name)}


def _reached(edges: dict[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    left = list(edges[start])
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += edges[name]
    return found


def _depth(edges: dict[str, set[str]]) -> int:
    """Return the longest chain of imports; modules in cycles count once."""
    depth: dict[str, int] = {}

    def of(name: str, above: frozenset[str]) -> int:
        if name not in depth:
            below = [of(each, above | {name}) for each in edges[name] if each not in above]
            depth[name] = 1 + max(below, default=0)
        return depth[name]

    return max(of(name, frozenset()) for name in edges)


def _count(trees: dict[str, ast.Module], wanted: Callable[[ast.AST], bool]) -> int:
    return sum(wanted(node) for tree in trees.values() for node in ast.walk(tree))


def _is_flag(node: ast.AST) -> bool:
    """Return whether a class says by a flag which controllers its agents have."""
    target = node.target if isinstance(node, ast.AnnAssign) else None
    return isinstance(target, ast.Name) and target.id in FLAGS


def _is_type_test(node: ast.AST) -> bool:
    """Return whether the type of a planner or an agent is asked for."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance"):
        return False
    return ast.unparse(node.args[0]).rpartition(".")[2] in OWNERS


if __name__ == "__main__":
    main()
