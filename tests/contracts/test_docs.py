"""The Python examples of README.md and of the pages in docs run as they are printed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md")))
EXAMPLES = [
    (page, number, code)
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL))
]


def test_examples_are_found():
    found = [page for page, _, _ in EXAMPLES]
    assert found.count("README.md") == 2
    assert found.count("docs/environments.md") == 3
    assert len(set(found)) >= 8


@pytest.mark.parametrize(
    ("page", "number", "code"), EXAMPLES, ids=[f"{page}-{number}" for page, number, _ in EXAMPLES]
)
def test_example_runs(page, number, code):
    exec(compile(code, f"{page}, example {number + 1}", "exec"), {})
